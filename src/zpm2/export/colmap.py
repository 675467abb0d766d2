"""A database of COLMAP, ready for its mapper (extra `colmap`)."""

from pathlib import Path

import numpy as np

from zpm2.errors import InputError
from zpm2.export.keypoints import Keypoints
from zpm2.files.record import move_into_place, temporary_folder
from zpm2.files.writing import atomic_write
from zpm2.formats.colmap import colmap_can, require_pycolmap, seeded

DATABASE, PAIRS = FILES = ("database.db", "pairs.txt")


def write(keypoints: Keypoints, folder: Path, seed: int) -> None:
    """Writes database.db and pairs.txt into an existing folder: photographs with cameras by their EXIF, keypoints,
    matches, and what COLMAP's geometric verification accepts of them. `InputError` where COLMAP cannot read a
    photograph.

    Names start from `keypoints.root`, which is the image path that COLMAP's mapper has to be given.
    """
    pycolmap = require_pycolmap()
    lines = "".join(f"{' '.join(pair.names)}\n" for pair in keypoints.pairs if len(pair.rows))
    with temporary_folder(folder) as part, colmap_can(f"use the photographs in {keypoints.root}"):
        file = part / DATABASE
        pycolmap.Database.open(str(file)).close()
        pycolmap.import_images(file, keypoints.root, pycolmap.CameraMode.AUTO, list(keypoints.points))
        database = pycolmap.Database.open(str(file))
        try:
            number = {image.name: image.image_id for image in database.read_all_images()}
            if missing := [name for name in keypoints.points if name not in number]:
                raise InputError(f"COLMAP cannot read the photograph {keypoints.root / missing[0]}: convert it first")
            for name, points in keypoints.points.items():
                database.write_keypoints(number[name], points.astype(np.float32))
            for pair in keypoints.pairs:
                if len(pair.rows):
                    database.write_matches(*(number[name] for name in pair.names), pair.rows.astype(np.uint32))
        finally:
            database.close()
        pairs = atomic_write(folder / PAIRS, lines)
        pycolmap.verify_matches(file, pairs, seeded(pycolmap.TwoViewGeometryOptions(), seed))
        move_into_place(file, folder / DATABASE)
