"""SceneFlow (Mayer et al. 2016): FlyingThings3D, Driving and Monkaa, rendered rectified pairs with full disparity."""

from collections.abc import Iterator
from pathlib import Path

from zpm2.errors import ConfigError
from zpm2.evaluate.datasets.layout import found, path_name, together
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.files.listing import existing, folders

SPLITS = ("TRAIN", "TEST", "driving", "monkaa")
SUBSETS = ("flyingthings3d", "driving", "monkaa")
RENDERS = ("cleanpass", "finalpass")


@dataset("sceneflow", truth="disparity, every pixel", splits=SPLITS)
def pairs(root: Path, split: str | None, *, render: str | None = None) -> Iterator[EvalPair]:
    """All pairs below `root`, which holds the archives of one subset or of all, or a folder for each subset.

        [FlyingThings3D/]frames_cleanpass[_webp]/TRAIN/A/0000/{left,right}/0006.png|webp
        [Driving/]frames_cleanpass[_webp]/35mm_focallength/scene_forwards/fast/{left,right}/0001.png|webp
        [Monkaa/]frames_cleanpass[_webp]/a_rain_of_stones_x2/{left,right}/0000.png|webp
        disparity/ beside the frames, the same folders, left/0006.pfm

    split: TRAIN or TEST of FlyingThings3D, driving or monkaa; None for all that is there. render: "cleanpass" or
    "finalpass"; None takes the clean pass where it is there. The name of a pair begins with its render.
    """
    if render not in (None, *RENDERS):
        raise ConfigError(f"unknown render '{render}': give {' or '.join(RENDERS)}")
    frames = _frames(root, RENDERS if render is None else (render,))
    looked = [folder / (split if split in ("TRAIN", "TEST") else "") for folder in frames]
    return found((pair for folder in frames for pair in _below(folder, split)), *looked)


def _frames(root: Path, renders: tuple[str, ...]) -> list[Path]:
    """The folders of frames, one for each base folder that has any."""
    names = [f"frames_{render}{end}" for render in renders for end in ("", "_webp")]
    subsets = [folder for folder in folders(root) if folder.name.lower() in SUBSETS]
    bases = [root, *subsets] if not subsets or any((root / name).is_dir() for name in names) else subsets
    return [existing(*(base / name for name in names)) for base in bases]


def _below(frames: Path, split: str | None) -> Iterator[EvalPair]:
    for top in folders(frames):
        if split in (None, _split(top.name)):
            for left in _left_folders(top):
                yield from _pairs_of(frames, left)


def _split(top: str) -> str:
    if top in ("TRAIN", "TEST"):
        return top
    return "driving" if top.endswith("mm_focallength") else "monkaa"


def _left_folders(folder: Path) -> Iterator[Path]:
    if (folder / "left").is_dir():
        yield folder / "left"
        return
    for child in folders(folder):
        yield from _left_folders(child)


def _pairs_of(frames: Path, left: Path) -> Iterator[EvalPair]:
    scene = left.parent.relative_to(frames)
    render = frames.name.removeprefix("frames_").removesuffix("_webp")
    right, disparity = left.parent / "right", frames.parent / "disparity" / scene / "left"
    for name in together(left, right):
        image, other = existing(left / name), existing(right / name)
        truth = DisparityTruth(existing(disparity / f"{image.stem}.pfm"), sign=0)  # parts of it store -d
        yield EvalPair(path_name(render, *scene.parts, image.stem), image, other, truth)
