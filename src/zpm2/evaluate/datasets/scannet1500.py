"""ScanNet1500: the 1,500 test pairs that SuperGlue (Sarlin et al. 2020) chose for relative pose.

The index is either that of LoFTR, `test.npz` with `intrinsics.npz`, or SuperGlue's text file.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.evaluate.datasets import scannet
from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import Array, EvalPair
from zpm2.files.listing import existing, text
from zpm2.formats import cameras
from zpm2.photos.listing import image_size

SPLITS = ("test", "sample")
_FOLDERS = ("", "scannet_test_1500", "scans_test")
_FRAME = re.compile(r"(scene\d{4}_\d\d)\D*?(\d+)(?:\.color)?\.\w+$")


@dataset("scannet1500", truth="pose; depth, too, where a scene has it", splits=SPLITS)
def pairs(root: Path, split: str | None) -> Iterator[EvalPair]:
    """The pairs of an index in `root`, in its order.

        test.npz          name (n, 4): scene, sub-scene, left and right frame; rel_pose (n, 12): [R | t] left to right
        intrinsics.npz    K by scene, for pictures of 640 x 480 px, centres from 0
        scannet_test_pairs_with_gt.txt    left right rotation rotation K K T, for pictures of 1296 x 968 px, from 0

    Pictures: `[scannet_test_1500/|scans_test/]scene0707_00/color/15.jpg`, or as the text file calls them. K is
    scaled to the size of the stored picture. Where a scene has a folder `depth` the truth has depth too. split: test
    (None; test.npz before the text file) or sample, SuperGlue's fifteen pairs `scannet_sample_pairs_with_gt.txt`.
    """
    if split == "sample":
        index = existing(root / "scannet_sample_pairs_with_gt.txt")
    else:
        index = existing(root / "test.npz", root / "scannet_test_pairs_with_gt.txt")
    return found(_from_archive(root, index) if index.suffix == ".npz" else _from_text(root, index), index)


def _from_archive(root: Path, index: Path) -> Iterator[EvalPair]:
    table, intrinsics = cameras.archive(index), cameras.archive(root / "intrinsics.npz")
    for key in ("name", "rel_pose"):
        if key not in table or len(table[key]) != len(table.get("name", ())):
            raise InputError(f"{index} has no '{key}' for every pair: download it again")
    for row, pose in zip(table["name"], table["rel_pose"], strict=True):
        scene, frames = _scene(row, index)
        if scene not in intrinsics:
            raise InputError(f"{root / 'intrinsics.npz'} has no '{scene}': download it again")
        what = f"{scene} {frames[0]} {frames[1]} in {index}"
        full = np.vstack([np.asarray(pose, np.float64).reshape(-1)[:12].reshape(-1, 4), [0, 0, 0, 1]])
        k = cameras.calibration(intrinsics[scene], f"K of {scene} in {root / 'intrinsics.npz'}")
        images = [_picture(root, scene, frame) for frame in frames]
        yield _pair(scene, images, frames, (k, k), scannet.DEPTH, cameras.rigid(full, f"pose of {what}"))


def _scene(row: NDArray[np.generic], index: Path) -> tuple[str, list[str]]:
    try:
        scene, part, left, right = (int(value) for value in row)
    except (TypeError, ValueError) as error:
        raise InputError(f"{index} has a row of 'name' that is not four whole numbers: download it again") from error
    return f"scene{scene:04d}_{part:02d}", [str(left), str(right)]


def _from_text(root: Path, index: Path) -> Iterator[EvalPair]:
    lines = (line.split() for line in text(index).splitlines() if line.strip())
    for number, words in enumerate(lines, 1):
        what = f"{index} line {number}"
        if len(words) != 38:
            raise InputError(f"{what} has {len(words)} words, not 38: download it again")
        values = cameras.numbers(words[2:], index)
        if values[:2].any():
            raise InputError(f"{what} asks for pictures that are turned by 90 degrees: turn them and write 0 0")
        scenes, frames = zip(*(_frame(name, what) for name in words[:2]), strict=True)
        images = [_named(root, *item) for item in zip(words[:2], scenes, frames, strict=True)]
        k = cameras.calibration(values[2:11], f"K0 of {what}"), cameras.calibration(values[11:20], f"K1 of {what}")
        yield _pair(scenes[0], images, frames, k, scannet.COLOUR, cameras.rigid(values[20:], f"pose of {what}"))


def _frame(name: str, what: str) -> tuple[str, str]:
    match = _FRAME.search(name)
    if not match:
        raise InputError(f"{what} names '{name}', no frame of a ScanNet scene: download it again")
    return match[1], str(int(match[2]))


def _named(root: Path, name: str, scene: str, frame: str) -> Path:
    """The picture where the text file says, else where SensReader puts it."""
    return _picture(root, scene, frame, root / name, root / "scannet_sample_images" / name)


def _picture(root: Path, scene: str, frame: str, *first: Path) -> Path:
    return existing(*first, *(root / folder / scene / "color" / f"{frame}.jpg" for folder in _FOLDERS))


def _pair(
    scene: str,
    images: list[Path],
    frames: Sequence[str],
    intrinsics: tuple[Array, Array],
    size: tuple[int, int],
    pose: Array,
) -> EvalPair:
    """The pair of `images`; `intrinsics` are for pictures of `size` px and count pixel centres from 0."""
    left, right = images
    scaled = [
        cameras.resized(cameras.intrinsics(k), size, image_size(image))
        for k, image in zip(intrinsics, images, strict=True)
    ]
    truth = scannet.truth(left, right, (scaled[0], scaled[1]), pose)
    return EvalPair(path_name(scene, f"{frames[0]}-{frames[1]}"), left, right, truth)
