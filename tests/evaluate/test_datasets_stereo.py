from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from dataset_files import file, files, listed, picture, sample

from zpm2.errors import ConfigError, InputError
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import DisparityTruth
from zpm2.formats.maps import read_map


def flying_things(root: Path, frames: str = "frames_cleanpass", ending: str = "png") -> None:
    for scene, frame in (("TRAIN/A/0000", "0006"), ("TRAIN/B/0010", "0007"), ("TEST/C/0149", "0015")):
        files(root / frames / scene, f"left/{frame}.{ending}", f"right/{frame}.{ending}")
        file(root / "disparity" / scene / "left" / f"{frame}.pfm")


def driving(root: Path) -> None:
    scene = "35mm_focallength/scene_forwards/fast"
    files(root / "frames_cleanpass" / scene, "left/0001.png", "right/0001.png")
    file(root / "disparity" / scene / "left" / "0001.pfm")


def monkaa(root: Path) -> None:
    for frame in ("0000", "0001"):
        files(root / "frames_cleanpass/a_rain_of_stones_x2", f"left/{frame}.png", f"right/{frame}.png")
        file(root / "disparity/a_rain_of_stones_x2/left" / f"{frame}.pfm")


def kitti_2015(root: Path) -> None:
    for frame in ("000000_10", "000000_11", "000001_10"):
        files(root / "training", f"image_2/{frame}.png", f"image_3/{frame}.png")
        files(root / "testing", f"image_2/{frame}.png", f"image_3/{frame}.png")
    for frame in ("000000_10", "000001_10"):
        files(root / "training", f"disp_occ_0/{frame}.png", f"disp_noc_0/{frame}.png")


def kitti_2012(root: Path) -> None:
    for frame in ("000000_10", "000000_11"):
        files(root / "training", *(f"{kind}/{frame}.png" for kind in ("colored_0", "colored_1", "image_0", "image_1")))
    files(root / "training", "disp_occ/000000_10.png", "disp_noc/000000_10.png", "calib/000000.txt")


def eth3d(root: Path) -> None:
    for scene in ("delivery_area_1l", "playground_1l"):
        files(root / "two_view_training" / scene, "im0.png", "im1.png", "calib.txt")
        files(root / "two_view_training_gt" / scene, "disp0GT.pfm", "mask0nocc.png")
    files(root / "two_view_test" / "lakeside_1l", "im0.png", "im1.png")


def middlebury_2014(root: Path) -> None:
    for scene, truth in (("2014/Adirondack-perfect", "disp0"), ("trainingQ/Adirondack", "disp0GT")):
        files(root / scene, "im0.png", "im1.png", "im1E.png", f"{truth}.pfm", "calib.txt")


def names(pairs: list) -> list[str]:
    return [pair.name for pair in pairs]


def test_flying_things(tmp_path):
    flying_things(tmp_path)
    pairs = listed("sceneflow", tmp_path)
    assert names(pairs) == ["cleanpass/TEST/C/0149/0015", "cleanpass/TRAIN/A/0000/0006", "cleanpass/TRAIN/B/0010/0007"]
    assert pairs[1].left == tmp_path / "frames_cleanpass/TRAIN/A/0000/left/0006.png"
    assert pairs[1].right == tmp_path / "frames_cleanpass/TRAIN/A/0000/right/0006.png"
    assert pairs[1].truth == DisparityTruth(tmp_path / "disparity/TRAIN/A/0000/left/0006.pfm", 1.0, sign=0)
    assert names(listed("sceneflow", tmp_path, "TEST")) == ["cleanpass/TEST/C/0149/0015"]


def test_flying_things_as_webp(tmp_path):
    flying_things(tmp_path, "frames_finalpass_webp", "webp")
    (pair,) = listed("sceneflow", tmp_path, "TEST", render="finalpass")
    assert pair.name == "finalpass/TEST/C/0149/0015"
    assert pair.right == tmp_path / "frames_finalpass_webp/TEST/C/0149/right/0015.webp"
    with pytest.raises(InputError, match=r"frames_cleanpass and .*frames_cleanpass_webp"):
        listed("sceneflow", tmp_path, render="cleanpass")
    with pytest.raises(ConfigError, match="cleanpass or finalpass"):
        listed("sceneflow", tmp_path, render="clean")


@pytest.mark.parametrize("subsets", [("", "", ""), ("FlyingThings3D", "Driving", "Monkaa")])
def test_the_subsets_of_sceneflow_together(tmp_path, subsets):
    for write, subset in zip((flying_things, driving, monkaa), subsets, strict=True):
        write(tmp_path / subset)
    assert len(listed("sceneflow", tmp_path)) == 6
    assert names(listed("sceneflow", tmp_path, "driving")) == ["cleanpass/35mm_focallength/scene_forwards/fast/0001"]
    assert names(listed("sceneflow", tmp_path, "monkaa")) == [
        "cleanpass/a_rain_of_stones_x2/0000",
        "cleanpass/a_rain_of_stones_x2/0001",
    ]


def test_a_subset_without_frames_is_not_passed_over(tmp_path):
    monkaa(tmp_path / "Monkaa")
    (tmp_path / "Driving").mkdir()
    with pytest.raises(InputError, match=r"Driving/frames_cleanpass"):
        listed("sceneflow", tmp_path)


def test_kitti_2015(tmp_path):
    kitti_2015(tmp_path)
    pairs = listed("kitti2015", tmp_path)
    assert names(pairs) == ["training/000000_10", "training/000001_10"]
    folder = tmp_path / "training"
    assert (pairs[1].left, pairs[1].right) == (folder / "image_2/000001_10.png", folder / "image_3/000001_10.png")
    assert pairs[1].truth == DisparityTruth(folder / "disp_occ_0/000001_10.png", 256.0)
    (seen, _) = listed("kitti2015", tmp_path, "training", occluded=False)
    assert seen.truth == DisparityTruth(folder / "disp_noc_0/000000_10.png", 256.0)
    testing = listed("kitti2015", tmp_path, "testing")
    assert [(pair.name, pair.truth) for pair in testing] == [("testing/000000_10", None), ("testing/000001_10", None)]


def test_kitti_2012_in_colour_and_in_grey(tmp_path):
    kitti_2012(tmp_path)
    folder = tmp_path / "training"
    (pair,) = listed("kitti2012", tmp_path)
    assert (pair.left, pair.right) == (folder / "colored_0/000000_10.png", folder / "colored_1/000000_10.png")
    assert pair.truth == DisparityTruth(folder / "disp_occ/000000_10.png", 256.0)
    (folder / "colored_0").rename(tmp_path / "elsewhere")
    (pair,) = listed("kitti2012", tmp_path)
    assert (pair.name, pair.left) == ("training/000000_10-grey", folder / "image_0/000000_10.png")


def test_kitti_scale_gives_pixels(tmp_path):
    kitti_2015(tmp_path)
    stored = np.array([[0, 256], [384, 65535]], np.uint16)
    cv2.imwrite(str(tmp_path / "training/disp_occ_0/000000_10.png"), stored)
    truth = listed("kitti2015", tmp_path)[0].truth
    values = read_map(truth.file, (2, 2), truth.scale)
    np.testing.assert_array_equal(values, np.array([[np.nan, 1], [1.5, 65535 / 256]], np.float32))


def test_eth3d(tmp_path):
    eth3d(tmp_path)
    pairs = listed("eth3d", tmp_path)
    assert names(pairs) == ["delivery_area_1l", "playground_1l"]
    assert pairs[0].right == tmp_path / "two_view_training/delivery_area_1l/im1.png"
    assert pairs[0].truth == DisparityTruth(tmp_path / "two_view_training_gt/delivery_area_1l/disp0GT.pfm")
    assert [(pair.name, pair.truth) for pair in listed("eth3d", tmp_path, "test")] == [("lakeside_1l", None)]


def test_eth3d_unpacked_into_one_folder(tmp_path):
    files(tmp_path / "two_view_training/forest_1s", "im0.png", "im1.png", "disp0GT.pfm")
    (pair,) = listed("eth3d", tmp_path)
    assert pair.truth == DisparityTruth(tmp_path / "two_view_training/forest_1s/disp0GT.pfm")


def test_middlebury_2014_and_its_evaluation_sets(tmp_path):
    middlebury_2014(tmp_path)
    files(tmp_path / "testQ/Australia", "im0.png", "im1.png", "calib.txt")
    pairs = listed("middlebury", tmp_path)
    assert names(pairs) == ["2014/Adirondack-perfect", "testQ/Australia", "trainingQ/Adirondack"]
    assert pairs[0].truth == DisparityTruth(tmp_path / "2014/Adirondack-perfect/disp0.pfm")
    assert pairs[1].truth is None
    assert pairs[2].truth == DisparityTruth(tmp_path / "trainingQ/Adirondack/disp0GT.pfm")
    assert names(listed("middlebury", tmp_path, "trainingQ")) == ["trainingQ/Adirondack"]
    assert names(listed("middlebury", tmp_path / "trainingQ/Adirondack")) == ["Adirondack"]


@pytest.mark.parametrize(
    ("left", "right", "truth", "height", "scale"),
    [
        ("view1", "view5", "disp1", 1110, 1),
        ("view1", "view5", "disp1", 555, 2),
        ("view1", "view5", "disp1", 370, 3),
        ("im2", "im6", "disp2", 1500, 1),
        ("im2", "im6", "disp2", 750, 2),
        ("im2", "im6", "disp2", 375, 4),
    ],
)
def test_middlebury_scale_follows_the_size(tmp_path, left, right, truth, height, scale):
    picture(tmp_path / "Aloe" / f"{left}.png", 3, height)
    files(tmp_path / "Aloe", f"{right}.png", f"{truth}.png", "im0.png" if left == "im2" else "view0.png")
    (pair,) = listed("middlebury", tmp_path)
    assert pair.right == tmp_path / "Aloe" / f"{right}.png"
    assert pair.truth == DisparityTruth(tmp_path / "Aloe" / f"{truth}.png", scale)


def test_middlebury_of_an_unknown_size(tmp_path):
    picture(tmp_path / "Aloe/view1.png", 3, 400)
    files(tmp_path / "Aloe", "view5.png", "disp1.png")
    with pytest.raises(InputError, match=r"400 px high.*1110, 555, 370"):
        listed("middlebury", tmp_path)


@pytest.mark.parametrize(
    ("name", "write", "optional"),
    [
        ("sceneflow", flying_things, ()),
        ("sceneflow", driving, ()),
        ("sceneflow", monkaa, ()),
        ("kitti2015", kitti_2015, ("disp_noc", "_11", "testing")),
        ("kitti2012", kitti_2012, ("disp_noc", "_11", "calib", "image_")),
        ("eth3d", eth3d, ("test/", "calib", "mask")),
        ("middlebury", middlebury_2014, ("calib", "im1E")),
    ],
)
def test_each_missing_file_is_named(tmp_path: Path, name: str, write: Callable[[Path], None], optional: tuple[str]):
    write(tmp_path)
    whole = listed(name, tmp_path)
    for path in sorted(tmp_path.rglob("*.p*")):
        if any(word in path.as_posix() for word in optional):
            continue
        path.rename(tmp_path / "elsewhere")
        with pytest.raises(InputError) as caught:
            listed(name, tmp_path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
        (tmp_path / "elsewhere").rename(path)
    assert names(listed(name, tmp_path)) == names(whole)


@pytest.mark.parametrize(
    ("name", "split", "looked"),
    [
        ("sceneflow", None, "frames_cleanpass"),
        ("kitti2012", None, "training"),
        ("kitti2015", "testing", "testing"),
        ("middlebury", None, "im0.png"),
        ("middlebury", "2006", "2006"),
        ("eth3d", None, "two_view_training"),
    ],
)
def test_an_empty_folder(tmp_path, name, split, looked):
    with pytest.raises(InputError, match=looked):
        listed(name, tmp_path, split)


def test_pairs_before_a_missing_file_are_still_listed(tmp_path):
    kitti_2015(tmp_path)
    (tmp_path / "training/image_3/000001_10.png").unlink()
    pairs = open_dataset("kitti2015", tmp_path).pairs()
    assert next(pairs).name == "training/000000_10"
    with pytest.raises(InputError, match=r"image_3/000001_10\.png"):
        next(pairs)


@pytest.mark.parametrize(
    ("folder", "scale", "unknown"), [("cones", 4.0, True), ("teddy", 4.0, True), ("Cloth3", 2.0, True)]
)
def test_real_middlebury_of_2003_and_2006(folder, scale, unknown):
    (pair,) = listed("middlebury", sample(f"middlebury/{folder}"))
    assert pair.truth.scale == scale
    picture = cv2.imread(str(pair.left))
    disparity = read_map(pair.truth.file, picture.shape[1::-1], scale)
    assert np.isnan(disparity).any() == unknown
    assert same_colour(pair, disparity) < 20


def test_real_middlebury_of_2014():
    (pair,) = listed("middlebury", sample("middlebury/motorcycle_Q"))
    assert same_colour(pair, read_map(pair.truth.file, (741, 497))) < 20


@pytest.mark.parametrize(
    ("name", "source", "layout"),
    [
        (
            "kitti2015",
            "kitti/2015_000046_10",
            {"image_2": "training/image_2", "image_3": "training/image_3", "disp_occ_0": "training/disp_occ_0"},
        ),
        (
            "kitti2012",
            "kitti/2012_000070_10",
            {"colored_0": "training/colored_0", "colored_1": "training/colored_1", "disp_occ": "training/disp_occ"},
        ),
    ],
)
def test_real_kitti(tmp_path, name, source, layout):
    folder = sample(source)
    for given, published in layout.items():
        (tmp_path / published).mkdir(parents=True)
        (tmp_path / published / "000046_10.png").symlink_to(folder / f"{given}.png")
    (pair,) = listed(name, tmp_path)
    disparity = read_map(pair.truth.file, None, pair.truth.scale)
    assert 0.1 < np.isfinite(disparity).mean() < 0.3
    assert same_colour(pair, disparity) < 20


def test_real_sceneflow(tmp_path):
    folder = sample("sceneflow/FT3D_TRAIN_A_0000_0006")
    for given, published in (
        ("left.png", "frames_cleanpass/TRAIN/A/0000/left/0006.png"),
        ("right.png", "frames_cleanpass/TRAIN/A/0000/right/0006.png"),
        ("disp_left.pfm", "disparity/TRAIN/A/0000/left/0006.pfm"),
    ):
        (tmp_path / published).parent.mkdir(parents=True)
        (tmp_path / published).symlink_to(folder / given)
    (pair,) = listed("sceneflow", tmp_path, "TRAIN")
    assert same_colour(pair, read_map(pair.truth.file, (960, 540))) < 20


def same_colour(pair, disparity) -> float:
    """Median grey-level difference of the left image and the right one at the place that the disparity says."""
    left, right = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(int) for path in (pair.left, pair.right))
    y, x = np.nonzero(np.isfinite(disparity))
    there = np.round(x - disparity[y, x]).astype(int)
    inside = there >= 0
    y, x, there = y[inside], x[inside], there[inside]
    shuffled = np.median(np.abs(left[y, x] - np.roll(right, 60, axis=1)[y, there]))
    difference = np.median(np.abs(left[y, x] - right[y, there]))
    assert difference < shuffled
    return float(difference)
