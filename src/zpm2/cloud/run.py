"""A polygon cloud in one call: from a workspace, or from a rectified pair alone."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from zpm2 import api, memory
from zpm2 import config as configuration
from zpm2.cloud.build import MatchedPair, build
from zpm2.cloud.disparity_mesh import disparity_mesh
from zpm2.cloud.holes import fill_holes
from zpm2.cloud.neighbors import neighbor_pairs
from zpm2.cloud.rays import RayCaster, open_caster
from zpm2.cloud.result import PolygonCloud
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.workspace import PosedPhotograph, find_mesh, read_views
from zpm2.config import Config
from zpm2.errors import ConfigError, Failed, InputError
from zpm2.files.keys import key
from zpm2.files.record import make_folder, save_key, saved_key
from zpm2.files.writing import claim
from zpm2.formats.maps import read_disparity
from zpm2.formats.saving import DOCUMENT
from zpm2.model import Image, PointMatches
from zpm2.model.messages import about
from zpm2.photos.images import read_image
from zpm2.photos.listing import image_size
from zpm2.pipeline import matching_part, plugin_code
from zpm2.result import MatchResult
from zpm2.runtime import Progress
from zpm2.stereo import dense
from zpm2.stereo.calibration import read_calibration
from zpm2.stereo.camera_check import checked, doubts, fitting_size
from zpm2.stereo.intrinsics import read_camera
from zpm2.stereo.refine import Disparity
from zpm2.stereo.rig import Rig, rig_of

Place = str | Path


@dataclass(frozen=True)
class DisparityFile:
    """A disparity map of the left image: .pfm, .png or .npy. `ConfigError` for an impossible scale or sign."""

    file: Place
    scale: float = 1.0  # the file's values are divided by this
    sign: int = 1  # -1 where the file stores -d

    def __post_init__(self) -> None:
        if not 0 < self.scale < float("inf"):
            raise ConfigError(f"scale {self.scale} of {self.file}: give a number above 0")
        check_sign(self.sign, f"sign {self.sign} of {self.file}")


def check_sign(sign: int, what: str) -> None:
    """`ConfigError` unless `sign` is 1 or -1. `what` names it in the message."""
    if sign not in (1, -1):
        raise ConfigError(f"{what}: give 1, or -1 where the file stores -d")


def from_workspace(
    folder: Place,
    config: Config | str = "default",
    *,
    mesh: Place | None = None,
    images: Place | None = None,
    cameras: Place | None = None,
    non_overlapping: bool = False,
    kept: Place | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> PolygonCloud:
    """Match the photographs of a workspace with their neighbours, and lift the matched polygons onto its mesh.

        cloud = zpm2.cloud.from_workspace("ws")
        zpm2.cloud.save(cloud, "out")

    mesh, images, cameras: where these are, if not in the usual places of the workspace (`cloud.workspace`).
    non_overlapping: make regions exclude each other before they are lifted. kept: a folder that stores the matches of
    each pair; they are used again if photographs, configuration and code are the same. say: called with a message if
    casting rays will be slow, or kept matches are damaged. `InputError` for an incomplete workspace,
    `MissingDependency` without trimesh, and the errors of `Matcher`.
    """
    pairs = _Pairs(configuration.as_config(config), non_overlapping, _path(kept), progress, say)
    place, odd = Path(folder), list[str]()
    views = read_views(place, _path(images), _path(cameras), odd)
    progress("mesh", 0.0)
    surface = fill_holes(SurfaceMesh.read(_path(mesh) or find_mesh(place)), pairs.config.cloud)
    progress("mesh", 1.0)
    caster = _caster(surface, say)
    chosen = neighbor_pairs([view.camera for view in views], surface, caster, pairs.config.cloud)
    matched = []
    for k, (i, j) in enumerate(chosen):
        progress("pairs", k / len(chosen))
        matched.append(MatchedPair(i, j, pairs.match(views[i], views[j])))
    progress("pairs", 1.0)
    return _built(views, matched, surface, caster, pairs, odd)


def from_stereo(
    left: Place,
    right: Place,
    rig: Rig,
    config: Config | str = "default",
    *,
    disparity: DisparityFile | Place | None = None,
    matches: Place | None = None,
    non_overlapping: bool = False,
    kept: Place | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> PolygonCloud:
    """Lift the matched polygons of a rectified pair onto the surface that its disparity map describes.

        rig = zpm2.cloud.read_rig("left.png", "right.png", k="300,300,200,120", baseline=0.2)
        cloud = zpm2.cloud.from_stereo("left.png", "right.png", rig)

    The cloud is in the frame of the left camera, in the unit of the baseline. disparity: a map of the left image; None
    searches the disparities (`stereo.method`). matches: a folder written by `MatchResult.save`; None matches the pair.
    Other arguments and errors are those of `from_workspace`. Also `InputError` if the disparities contradict the
    matched points, or their search takes too much memory, and `MissingDependency` for mc-cnn without libsgm.
    """
    pairs = _Pairs(configuration.as_config(config), non_overlapping, _path(kept), progress, say)
    photographs = [Path(left), Path(right)]
    names, raster = ("left", "right"), pairs.config.raster
    images = [read_image(path, f"{name} image", raster) for path, name in zip(photographs, names, strict=True)]
    sizes = [(image.width, image.height) for image in images]
    odd = [*doubts(rig.left, "the left camera"), *doubts(rig.right, "the right camera")]
    surface_of = _searched(images, pairs.config) if disparity is None else _given(disparity, sizes[0])
    views = [PosedPhotograph(path.name, path, camera) for path, camera in zip(photographs, rig.views, strict=True)]
    if matches is None:
        result = pairs.match(views[0], views[1])
    else:
        result = pairs.finished(api.saved_matches(matches, photographs, sizes))
    points = result.points
    progress("mesh", 0.0)
    surface = fill_holes(disparity_mesh(surface_of(points), rig, pairs.config.cloud), pairs.config.cloud)
    progress("mesh", 1.0)
    return _built(views, [MatchedPair(0, 1, result)], surface, _caster(surface, say), pairs, odd)


def read_rig(
    left: Place,
    right: Place,
    *,
    calibration: Place | None = None,
    k: str | None = None,
    k2: str | None = None,
    baseline: float | None = None,
) -> Rig:
    """The rig of a rectified pair: from a calibration file of Middlebury or KITTI, or from K and baseline.

    k, k2: the left and the right camera, written as for `--K` of `zpm2 pose`; without `k2`, `k` is used for both.
    baseline: the distance between the cameras, in the unit that the cloud should have. `ConfigError` if the cameras
    are missing or given twice; `InputError` if they do not fit the photographs or each other.
    """
    photographs = Path(left), Path(right)
    if calibration is not None:
        if any(value is not None for value in (k, k2, baseline)):
            raise ConfigError("--calib gives the cameras and the baseline: leave out --K, --K2 and --baseline")
        rig = read_calibration(Path(calibration), image_size(photographs[0]))
        for name, camera, path in zip(("left", "right"), (rig.left, rig.right), photographs, strict=True):
            what = f"the {name} camera of {calibration}"
            checked(fitting_size(camera, image_size(path), what, str(path)), what, str(path))
        return rig
    if k is None or baseline is None:
        raise ConfigError("--stereo needs the cameras: give --calib, or --K and --baseline")
    cameras = [
        read_camera(text, path, image_size(path), name=name)
        for text, path, name in zip((k, k2 or k), photographs, ("K", "K2"), strict=True)
    ]
    return rig_of(cameras[0], cameras[1], baseline)


def _searched(images: Sequence[Image], config: Config) -> Callable[[PointMatches], Disparity]:
    """The disparities of a pair, to be searched where its points are."""
    find = dense.stereo_matcher(config.stereo, config.device)

    def searched(points: PointMatches) -> Disparity:
        bounds = dense.disparity_range(points.left[:, 0] - points.right[:, 0], images[0].width, config.stereo)
        if isinstance(bounds, Failed):
            raise InputError(f"no surface from this pair: {bounds}; give --disparity")
        with memory.within(config.max_memory):
            return find(images[0], images[1], *bounds)

    return searched


def _given(file: DisparityFile | Place, size: tuple[int, int]) -> Callable[[PointMatches], Disparity]:
    """The disparities of a file, to be checked against the points of its pair."""
    map_ = file if isinstance(file, DisparityFile) else DisparityFile(file)
    disparity = read_disparity(Path(map_.file), size, map_.scale, map_.sign)

    def checked_against(points: PointMatches) -> Disparity:
        dense.refuse_other_disparity(disparity, points.left, points.right)
        return disparity

    return checked_against


class _Pairs:
    """Matches pairs of views. If a folder is given, matches are stored there and used again."""

    def __init__(
        self,
        config: Config,
        non_overlapping: bool,
        folder: Path | None,
        progress: Progress,
        say: Callable[[str], None],
    ) -> None:
        self.config, self.non_overlapping, self.folder = config, non_overlapping, folder
        self.progress, self.say = progress, say
        self._matcher: api.Matcher | None = None

    def match(self, left: PosedPhotograph, right: PosedPhotograph) -> MatchResult:
        """The matches of two views. The result does not keep the pixels of the photographs."""
        return self.finished(
            _without_pixels(self._match(left, right)) if self.folder is None else self._kept(self.folder, left, right)
        )

    def finished(self, result: MatchResult) -> MatchResult:
        """The result that is lifted: without overlaps if the caller asked for that."""
        return result.flatten() if self.non_overlapping else result

    def _kept(self, home: Path, left: PosedPhotograph, right: PosedPhotograph) -> MatchResult:
        name = "-".join(str(Path(view.name).with_suffix("")).replace("/", "_") for view in (left, right))
        folder, made_from = (
            home / name,
            key([left.path, right.path], matching_part(self.config), *plugin_code(self.config)),
        )
        if saved_key(folder) != made_from or not (folder / DOCUMENT).exists():
            result = self._match(left, right)
            claim(make_folder(home), [])
            result.save(make_folder(folder))
            save_key(folder, made_from)
        try:
            return MatchResult.load(folder)
        except InputError:
            self.say(
                f"{folder / DOCUMENT} cannot be read, the pair is matched again: remove it to keep the new matches"
            )
            return _without_pixels(self._match(left, right))

    def _match(self, left: PosedPhotograph, right: PosedPhotograph) -> MatchResult:
        if self._matcher is None:
            self._matcher = api.Matcher(self.config, progress=self.progress, say=self.say)
        return self._matcher(left.path, right.path)


def _without_pixels(result: MatchResult) -> MatchResult:
    left, right = (dataclasses.replace(side, image=None) for side in (result.left, result.right))
    return dataclasses.replace(result, left=left, right=right)


def _built(
    views: Sequence[PosedPhotograph],
    matched: Sequence[MatchedPair],
    surface: SurfaceMesh,
    caster: RayCaster,
    pairs: _Pairs,
    odd: Sequence[str],
) -> PolygonCloud:
    """The cloud. Its messages include doubts about the cameras (`odd`) and the messages of the matches."""
    made = build(views, matched, surface, caster, pairs.config.cloud, pairs.progress, pairs.config.tracks)
    warnings, notes = [*odd, *made.warnings], list(made.notes)
    for pair in matched:
        names = f"{views[pair.left].name}, {views[pair.right].name}"
        warnings += about(names, pair.result.warnings)
        notes += about(names, pair.result.notes)
    return dataclasses.replace(made, config=pairs.config.to_dict(), warnings=warnings, notes=notes)


def _caster(surface: SurfaceMesh, say: Callable[[str], None]) -> RayCaster:
    """The ray caster of a surface. A slow one is announced before the wait begins."""
    caster = open_caster(surface)
    if caster.note:
        say(caster.note)
    return caster


def _path(place: Place | None) -> Path | None:
    return None if place is None else Path(place)
