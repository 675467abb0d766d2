"""The relative pose of two photographs by one call: read, matched, oriented; and the files of that."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from zpm2 import api, memory
from zpm2 import config as configuration
from zpm2.config import Config
from zpm2.errors import ConfigError, Failed
from zpm2.files.listing import distinct_names
from zpm2.files.record import make_folder, remove_made
from zpm2.files.writing import atomic_write, claim
from zpm2.formats import geojson
from zpm2.formats.colmap import require_pycolmap
from zpm2.model import SIDES, Camera, Image, counterparts
from zpm2.model.brief import brief
from zpm2.photos.images import read_image
from zpm2.photos.pictures import png
from zpm2.pose import colmap
from zpm2.pose.rectify import rectify
from zpm2.pose.relative import PoseFinder
from zpm2.pose.result import NAME, PoseResult
from zpm2.result import MatchResult
from zpm2.runtime import Progress, resolve_device
from zpm2.stereo.intrinsics import from_exif, read_camera, refuse_swapped
from zpm2.stereo.rectify import RectifiedPair

RECTIFIED, COLMAP = "rectified", "colmap"  # folders

Place = str | Path


class Saved(NamedTuple):
    """What `OrientedPair.save` did."""

    written: list[Path]  # files and folders
    missing: list[str]  # what could not be made, and why


@dataclass(frozen=True, eq=False)
class OrientedPair:
    """Two photographs with their matches and their relative pose."""

    photographs: tuple[Path, Path]
    images: tuple[Image, Image]
    matches: MatchResult
    pose: PoseResult
    config: Config = field(repr=False)

    __repr__ = brief

    def rectified(self) -> RectifiedPair | Failed:
        """Both images and the matched polygons as a rectified pair. `Failed` where the pose has no translation."""
        return rectify(self.pose, self.images, self.matches.matched_polygons(), self.config.stereo)

    def save(self, folder: Place, *, rectified: bool = False, as_colmap: bool = False) -> Saved:
        """Write pose.json into a folder, and if asked for the folders rectified/ and colmap/ (`file_names`).

        The matches are not written; they have a `save` of their own. `OutputError` where something else has one of the
        names, `MissingDependency` where `as_colmap` needs pycolmap.
        """
        out, written, missing = claim(folder, file_names(rectified, as_colmap)), list[Path](), list[str]()
        for name in file_names(rectified=True, as_colmap=True):  # of an earlier pose
            remove_made(out, name)
        if rectified:
            pair = self.rectified()
            if isinstance(pair, Failed):
                missing.append(f"not rectified: {pair}")
            else:
                written.append(_save_rectified(pair, self.matches, make_folder(out / RECTIFIED)))
        if as_colmap:
            if isinstance(self.pose.pose, Failed) or self.pose.translation is None:
                missing.append("no COLMAP model: it needs a pose with a translation")
            else:
                left, right = distinct_names(self.photographs)
                written.append(colmap.write(self.pose, (left, right), make_folder(out / COLMAP)))
        self.pose.save(out)
        return Saved([out / NAME, *written], missing)


def find(
    left: Place,
    right: Place,
    config: Config | str = "default",
    *,
    k: str | None = None,
    k2: str | None = None,
    centers: float = 0.5,
    baseline: float | None = None,
    matches: Place | None = None,
    matched: Callable[[MatchResult], object] = lambda result: None,
    match: api.PairFunction | None = None,
    finder: PoseFinder | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> OrientedPair:
    """Match two photographs and estimate how the right camera stands to the left one: X_right = R X_left + t.

        pair = zpm2.pose.find("left.png", "right.png", k="300,300,200,120")
        if pair.pose.pose:
            print(pair.pose.pose.rotation, pair.pose.translation)

    k, k2: the cameras as `--K` of `zpm2 pose` takes them (`stereo.intrinsics.read_camera`); None: as EXIF tells, else
    estimated from the points. centers: where they have the centre of the first pixel, 0.5 or 0 px. baseline: the
    distance of the cameras; t has unit length without it. matches: a folder of `MatchResult.save`, None to match the
    pair; `matched` is given new matches before the pose is estimated, so that they can be saved. match, finder: what
    matches the pair and what finds its pose; for many pairs, a `Matcher` and a `PoseFinder` that are kept, so that
    models are loaded once. A pose that cannot be estimated is `Failed` in the result. `ConfigError`, `InputError` for
    what cannot be used, and errors of `Matcher`.
    """
    if baseline is not None and not 0 < baseline < float("inf"):
        raise ConfigError(f"--baseline {baseline}: give a length above 0")
    chosen = configuration.as_config(config)
    finder = finder or PoseFinder(chosen, device=resolve_device(chosen.device))
    photographs, raster = (Path(left), Path(right)), chosen.raster
    images = read_image(photographs[0], "left image", raster), read_image(photographs[1], "right image", raster)
    sizes = [(image.width, image.height) for image in images]
    cameras = read_cameras(photographs, sizes, (k, k2), centers)
    with memory.reserved(sum(image.rgb.nbytes for image in images)):
        if matches is None:
            result = (match or api.Matcher(chosen, progress=progress, say=say))(*photographs)
            matched(result)
        else:
            result = api.saved_matches(matches, photographs, sizes)
        progress("pose", 0.0)
        found = finder(result, cameras, images)
        progress("pose", 1.0)
    found = found if baseline is None else found.with_baseline(baseline)
    return OrientedPair(photographs, images, result, found, chosen)


def read_cameras(
    photographs: Sequence[Path],
    sizes: Sequence[tuple[int, int]],
    texts: tuple[str | None, str | None],
    centers: float = 0.5,
) -> tuple[Camera, Camera] | None:
    """The cameras of two photographs of `sizes` (width, height) px: as two `texts` give them (`read_camera`; the first
    for both where the second is None), else as EXIF tells. None where neither does."""
    if texts[0] is None:
        if texts[1] is not None:
            raise ConfigError("--K2 without --K: give both, or --K alone for two images of one camera")
        first, second = (from_exif(path, size) for path, size in zip(photographs, sizes, strict=True))
        return None if isinstance(first, Failed) or isinstance(second, Failed) else (first, second)
    if texts[1] is None and sizes[0] != sizes[1] and texts[0] not in ("exif", "guess"):
        shown = " and ".join(f"{width} x {height}" for width, height in sizes)
        raise ConfigError(f"the images have {shown} px: give --K2 for the right one")
    both = texts[0], texts[1] or texts[0]
    left, right = (
        read_camera(text, path, size, centers, name)
        for text, path, size, name in zip(both, photographs, sizes, ("K", "K2"), strict=True)
    )
    refuse_swapped((left, right))
    return left, right


def file_names(rectified: bool = False, as_colmap: bool = False) -> list[str]:
    """The names of the files and folders that `OrientedPair.save` may write."""
    return [NAME, *([RECTIFIED] if rectified else []), *([COLMAP] if as_colmap else [])]


def check_colmap(left: Place, right: Place) -> None:
    """What `OrientedPair.save(as_colmap=True)` needs, before the work begins: `MissingDependency` without pycolmap,
    `ConfigError` for one photograph given twice."""
    require_pycolmap()
    if len(set(distinct_names([Path(left), Path(right)]))) < 2:
        raise ConfigError(f"--colmap needs two photographs, {left} is given twice")


def _save_rectified(pair: RectifiedPair, matches: MatchResult, folder: Path) -> Path:
    for name, side in zip(SIDES, (pair.left, pair.right), strict=True):
        atomic_write(folder / f"{name}.png", png(side.image.rgb))
        width, height = side.camera.size
        partners = counterparts(matches.matches, name)
        collection = geojson.feature_collection(side.polygons, partners, f"{name}.png", width, height)
        geojson.write(folder / f"{name}.geojson", collection)
    atomic_write(folder / "rectification.json", json.dumps(pair.to_dict()))
    return folder
