"""KITTI stereo 2012 (Geiger et al. 2012) and 2015 (Menze et al. 2018): rectified street scenes, sparse lidar disparity.

Disparity is uint16 / 256, 0 where the lidar saw nothing. The truth of a rectified pair needs no calibration, so the
files of `calib` and `calib_cam_to_cam` are not read.
"""

from collections.abc import Iterator
from pathlib import Path

from zpm2.evaluate.datasets.layout import found, path_name, together
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.files.listing import existing

SPLITS = ("training", "testing")
SCALE = 256.0


@dataset("kitti2012", truth="disparity, sparse", splits=SPLITS)
def pairs_2012(root: Path, split: str | None, *, occluded: bool = True) -> Iterator[EvalPair]:
    """`training/{colored_0,colored_1}/000000_10.png` with `disp_occ/000000_10.png`.

    The grey pictures `image_0`, `image_1` are taken where the colour archive is not there; their names end in "-grey".
    split: training (None) or testing, which has no truth. occluded: False for `disp_noc`, without the pixels that the
    right camera does not see.
    """
    folder = existing(root / (split or "training"))
    colour = existing(folder / "colored_0", folder / "image_0").name == "colored_0"
    left, right, ending = ("colored_0", "colored_1", "") if colour else ("image_0", "image_1", "-grey")
    return _pairs(folder, left, right, "disp_occ" if occluded else "disp_noc", ending)


@dataset("kitti2015", truth="disparity, sparse", splits=SPLITS)
def pairs_2015(root: Path, split: str | None, *, occluded: bool = True) -> Iterator[EvalPair]:
    """`training/{image_2,image_3}/000000_10.png` with `disp_occ_0/000000_10.png`; split and occluded as for 2012."""
    folder = existing(root / (split or "training"))
    return _pairs(folder, "image_2", "image_3", "disp_occ_0" if occluded else "disp_noc_0", "")


def _pairs(folder: Path, left: str, right: str, disparity: str, ending: str) -> Iterator[EvalPair]:
    """Frames _10 (those with truth); frames _11 are for flow."""
    parts = [folder / left, folder / right] + ([] if folder.name == "testing" else [folder / disparity])
    files = ([existing(part / name) for part in parts] for name in together(*parts) if name.endswith("_10.png"))
    pairs = (
        EvalPair(path_name(folder.name, image.stem + ending), image, other, *(DisparityTruth(t, SCALE) for t in truth))
        for image, other, *truth in files
    )
    return found(pairs, folder / left / "000000_10.png")
