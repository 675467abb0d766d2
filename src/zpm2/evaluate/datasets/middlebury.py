"""Middlebury stereo of 2003, 2005, 2006, 2014 and 2021 and its evaluation sets: one scene a folder, dense disparity.

Scharstein and Szeliski 2003; Scharstein and Pal 2007; Hirschmueller and Scharstein 2007; Scharstein et al. 2014.
"""

from collections.abc import Iterator
from pathlib import Path

from zpm2.errors import InputError
from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.files.listing import existing, folders
from zpm2.photos.listing import image_size

SCALES_2003 = {1500: 1.0, 750: 2.0, 375: 4.0}  # by image height px: full, half, quarter size
SCALES_2006 = {1110: 1.0, 555: 2.0, 370: 3.0}  # full, half, third size
TESTING = ("testF", "testH", "testQ")
_PAIRS = (("im2.png", "im6.png"), ("view1.png", "view5.png"), ("im0.png", "im1.png"))  # sets of 2003 can have im0 too


@dataset("middlebury", truth="disparity")
def pairs(root: Path, split: str | None) -> Iterator[EvalPair]:
    """Every scene at or below `root`, told apart by the names of its files.

        2014, 2021, MiddEval3   im0.png, im1.png, disp0.pfm or disp0GT.pfm
        2005, 2006              view1.png, view5.png, disp1.png
        2003                    im2.png, im6.png, disp2.png

    A .png holds the disparity in px of the full size, so that the size of the image gives its scale. split: a folder
    below `root`, as trainingQ or 2014; None for all. Scenes in a folder testF, testH or testQ have no truth.
    """
    start = existing(root / split) if split else root
    looked = [start / "SCENE" / left for left, _ in _PAIRS]
    return found((_pair(root, scene, left, right) for scene, left, right in _scenes(start)), *looked)


def _scenes(folder: Path) -> Iterator[tuple[Path, str, str]]:
    for left, right in _PAIRS:
        if (folder / left).exists() or (folder / right).exists():
            yield folder, left, right
            return
    for child in folders(folder):
        yield from _scenes(child)


def _pair(root: Path, scene: Path, left: str, right: str) -> EvalPair:
    image = existing(scene / left)
    name = path_name(*(scene.relative_to(root).parts or (scene.resolve().name,)))
    testing = scene.resolve().parent.name in TESTING
    return EvalPair(name, image, existing(scene / right), None if testing else _truth(scene, image))


def _truth(scene: Path, image: Path) -> DisparityTruth:
    if image.name == "im0.png":
        return DisparityTruth(existing(scene / "disp0.pfm", scene / "disp0GT.pfm"))
    of_2006 = image.name == "view1.png"
    file = existing(scene / ("disp1.png" if of_2006 else "disp2.png"))
    scales = SCALES_2006 if of_2006 else SCALES_2003
    height = image_size(image)[1]
    if height not in scales:
        known = ", ".join(str(known) for known in scales)
        raise InputError(f"{image} is {height} px high, the scale of {file} is known for {known} px: give that size")
    return DisparityTruth(file, scales[height])
