"""Cameras and sparse points by COLMAP (Schoenberger and Frahm, CVPR 2016), through pycolmap."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from zpm2.config import Config
from zpm2.cores import usable
from zpm2.errors import InputError
from zpm2.files.record import make_folder, move_into_place, temporary_folder
from zpm2.formats.colmap import colmap_can, require_pycolmap, seeded, to_pycolmap
from zpm2.model import PosedCamera

if TYPE_CHECKING:
    from pycolmap import IncrementalPipelineOptions, Reconstruction, TwoViewGeometryOptions


def find_structure(
    images: Path,
    names: Sequence[str],
    workspace: Path,
    known: Mapping[str, PosedCamera] | None,
    config: Config,
) -> Path:
    """The model workspace/sparse/0 of the photographs `names` in `images`.

    known: cameras by name; then only points are triangulated. `InputError` where the photographs share too little.
    """
    model = workspace / "sparse" / "0"
    if (model / "cameras.bin").is_file():
        return model
    pycolmap = require_pycolmap()
    with temporary_folder(workspace) as part:
        with colmap_can(f"find cameras and points of {images}"):
            found = _reconstruct(pycolmap, images, names, part, known, config)
        if found.num_points3D() < config.reconstruct.min_points:
            raise InputError(f"the photographs in {images} have {found.num_points3D()} points in common: too few")
        (part / "0").mkdir()
        with colmap_can(f"write the model {model}"):
            found.write(str(part / "0"))
        make_folder(model.parent)
        return move_into_place(part / "0", model)


def _reconstruct(
    pycolmap: ModuleType,
    images: Path,
    names: Sequence[str],
    part: Path,
    known: Mapping[str, PosedCamera] | None,
    config: Config,
) -> "Reconstruction":
    """The model with the most photographs; intermediate files of COLMAP go to `part`."""
    database, models = part / "database.db", part / "models"
    models.mkdir()
    mode = pycolmap.CameraMode.AUTO if known is None else pycolmap.CameraMode.PER_IMAGE
    pycolmap.Database.open(str(database)).close()
    pycolmap.import_images(database, images, mode, names)  # first: extraction numbers them as its threads finish
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.num_threads = matching.num_threads = usable()  # COLMAP would take all cores that it sees
    pycolmap.extract_features(
        database, images, names, camera_mode=mode, extraction_options=extraction, device=pycolmap.Device.auto
    )
    if known is not None:
        _give_cameras(pycolmap, database, known)
    verification, mapping = _seeded(pycolmap, config.seed)
    if config.reconstruct.ordered:
        pycolmap.match_sequential(database, matching, verification_options=verification)
    else:
        pycolmap.match_exhaustive(database, matching, verification_options=verification)
    if known is not None:
        posed = _posed(pycolmap, database, known)
        return pycolmap.triangulate_points(posed, database, images, models, options=mapping)
    found = pycolmap.incremental_mapping(database, images, models, options=mapping)
    if not found:
        raise InputError(f"the photographs in {images} are not connected: take them with more overlap")
    return max(found.values(), key=lambda r: r.num_reg_images())


def _seeded(pycolmap: ModuleType, seed: int) -> tuple["TwoViewGeometryOptions", "IncrementalPipelineOptions"]:
    """Options of matching and of mapping that give the same model each time.

    The samples do not depend on the thread that draws them. The adjustment has one thread, as several would add up
    numbers in a different order each time.
    """
    pycolmap.set_random_seed(seed)
    verification, mapping = seeded(pycolmap.TwoViewGeometryOptions(), seed), pycolmap.IncrementalPipelineOptions()
    for draws in (mapping, mapping.mapper, mapping.triangulation):
        draws.random_seed = seed
    mapping.num_threads = 1
    return verification, mapping


def _give_cameras(pycolmap: ModuleType, file: Path, known: Mapping[str, PosedCamera]) -> None:
    """Puts the known cameras into a database."""
    database = pycolmap.Database.open(str(file))
    try:
        for image in database.read_all_images():
            database.update_camera(to_pycolmap(known[image.name].camera, image.camera_id))
    finally:
        database.close()


def _posed(pycolmap: ModuleType, file: Path, known: Mapping[str, PosedCamera]) -> "Reconstruction":
    """A model of the known cameras without points, its ids those of a database."""
    model = pycolmap.Reconstruction()
    database = pycolmap.Database.open(str(file))
    try:
        for image in database.read_all_images():
            camera = known[image.name]
            model.add_camera_with_trivial_rig(to_pycolmap(camera.camera, image.camera_id))
            made = pycolmap.Image(name=image.name, image_id=image.image_id, camera_id=image.camera_id)
            pose = pycolmap.Rigid3d(np.c_[camera.rotation, camera.translation])
            model.add_image_with_trivial_frame(made, pose)
    finally:
        database.close()
    return model
