"""ScanNet (Dai et al. 2017) as its SensReader exports it: indoor video with depth in mm and poses."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from zpm2.errors import ConfigError
from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import Array, DepthTruth, EvalPair, PoseTruth
from zpm2.files.listing import existing, folders
from zpm2.formats import cameras
from zpm2.photos.listing import image_size, photographs

COLOUR = (1296, 968)  # px, of the pictures for which intrinsic_color.txt holds
DEPTH = (640, 480)  # px, of the maps for which intrinsic_depth.txt holds


@dataset("scannet", truth="depth and pose")
def pairs(root: Path, split: str | None, *, gap: int = 10) -> Iterator[EvalPair]:
    """Pairs of frames, `gap` frame numbers or the next larger step that was exported apart, one after the other.

        [scans/|scans_test/]scene0707_00/color/0.jpg, depth/0.png, pose/0.txt, intrinsic/intrinsic_color.txt

    `root` may also be the folder of one scene. split: one scene; None for all. A pose file goes from camera to world;
    frames whose pose is not finite (tracking was lost) take no part. Where a scene has no folder `depth` the truth is
    the pose alone. K follows the size of the stored pictures; a scene without intrinsic_color.txt takes
    intrinsic_depth.txt, scaled from 640 x 480.
    """
    if gap < 1:
        raise ConfigError(f"gap must be at least 1 frame, got {gap}")
    if (root / "color").is_dir():
        scenes = [root]
    elif split:
        scenes = [existing(root / split, root / "scans" / split, root / "scans_test" / split)]
    else:
        bases = [base for base in (root, root / "scans", root / "scans_test") if base.is_dir()]
        scenes = [scene for base in bases for scene in folders(base) if scene.name.startswith("scene")]
    looked = [scene / "color" / "0.jpg" for scene in scenes[:1]] or [root / "sceneXXXX_YY" / "color" / "0.jpg"]
    return found((pair for scene in scenes for pair in _pairs(scene, gap)), *looked)


def truth(left: Path, right: Path, intrinsics: tuple[Array, Array], pose: Array) -> PoseTruth:
    """Pose and, where the scene of the two frames `color/N.jpg` has a folder `depth`, depth in mm."""
    folder = left.parent.parent / "depth"
    if not folder.is_dir():
        return PoseTruth(intrinsics, pose)
    return DepthTruth(intrinsics, pose, (existing(folder / f"{left.stem}.png"), existing(folder / f"{right.stem}.png")))


def _pairs(scene: Path, gap: int) -> Iterator[EvalPair]:
    left: tuple[Path, Array] | None = None
    for image in photographs(scene / "color", (".jpg", ".png")):
        if left and _number(image) < _number(left[0]) + gap:
            continue
        file = scene / "pose" / f"{image.stem}.txt"
        to_world = cameras.text_matrix(file)
        if not np.isfinite(to_world).all():
            continue
        camera = cameras.inverse(cameras.rigid(to_world, f"pose {file}"))
        if left:
            yield _pair(scene, left[0], image, cameras.between(left[1], camera))
        left = image, camera


def _number(image: Path) -> int:
    return int("".join(character for character in image.stem if character.isdecimal()) or 0)


def _pair(scene: Path, left: Path, right: Path, pose: Array) -> EvalPair:
    intrinsics = _intrinsics(scene, left), _intrinsics(scene, right)
    name = path_name(scene.resolve().name, f"{left.stem}-{right.stem}")
    return EvalPair(name, left, right, truth(left, right, intrinsics, pose))


def _intrinsics(scene: Path, image: Path) -> Array:
    folder = scene / "intrinsic"
    file = existing(folder / "intrinsic_color.txt", folder / "intrinsic_depth.txt")
    size = COLOUR if file.name == "intrinsic_color.txt" else DEPTH
    matrix = cameras.calibration(cameras.text_matrix(file)[:3, :3], f"K of {file}")
    return cameras.resized(cameras.intrinsics(matrix), size, image_size(image))
