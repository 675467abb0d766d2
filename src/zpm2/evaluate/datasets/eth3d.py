"""ETH3D low-resolution two-view stereo (Schoeps et al. 2017): rectified grey pairs, laser-scanned disparity."""

from collections.abc import Iterator
from pathlib import Path

from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.files.listing import existing, folders

SPLITS = ("training", "test")


@dataset("eth3d", truth="disparity", splits=SPLITS)
def pairs(root: Path, split: str | None) -> Iterator[EvalPair]:
    """`two_view_training/SCENE/{im0,im1}.png` with `two_view_training_gt/SCENE/disp0GT.pfm`.

    The truth may also lie in the folder of the images, where both archives were unpacked into one. split: training
    (None) or test, which has no truth.
    """
    split = split or "training"
    images = existing(root / f"two_view_{split}")
    truths = root / f"two_view_{split}_gt"
    scenes = sorted({scene.name for part in (images, truths) if part.is_dir() for scene in folders(part)})
    pairs = (_pair(images / scene, None if split == "test" else truths) for scene in scenes)
    return found(pairs, images / "SCENE" / "im0.png")


def _pair(scene: Path, truths: Path | None) -> EvalPair:
    left, right = existing(scene / "im0.png"), existing(scene / "im1.png")
    if truths is None:
        return EvalPair(path_name(scene.name), left, right)
    disparity = existing(truths / scene.name / "disp0GT.pfm", scene / "disp0GT.pfm")
    return EvalPair(path_name(scene.name), left, right, DisparityTruth(disparity))
