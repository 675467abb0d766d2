import json
import re
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from dataset_files import SAMPLES, file, files, listed, sample
from hypothesis import given
from hypothesis import strategies as st

from zpm2.errors import ConfigError, InputError
from zpm2.evaluate.datasets import DATASETS, dataset, layout, open_dataset
from zpm2.evaluate.pairs import DepthTruth, DisparityTruth, HomographyTruth, PoseTruth
from zpm2.geometry import project

ROOT = Path(__file__).resolve().parents[2]
K = [[500.0, 0, 100], [0, 500, 80], [0, 0, 1]]
OURS = [[500.0, 0, 100.5], [0, 500, 80.5], [0, 0, 1]]
T = [[1.0, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
H = [[1.1, 0.1, 20], [-0.05, 0.9, 8], [1e-4, 2e-4, 1]]


def write(root: Path, *truths: object, **more: object) -> None:
    """A `pairs.json` with a pair for each truth, and the files it speaks of."""
    files(root, "a.png", "b.png", "d.pfm", "d0.png", "d1.png")
    pair = {"set": "mine", "left": "a.png", "right": "b.png"}
    entries = [{"name": f"pair/{k}", **pair, "gt": truth, **more} for k, truth in enumerate(truths)]
    file(root / "pairs.json", json.dumps(entries))


def test_every_kind_of_truth(tmp_path):
    write(
        tmp_path,
        {"kind": "disparity", "file": "d.pfm"},
        {"kind": "disparity", "file": "d0.png", "scale": 256},
        {"kind": "depth", "file": "d0.png", "file1": "d1.png", "scale": 5000, "K0": K, "K1": K, "T_0to1": T},
        {"kind": "depth", "file": "d0.png", "K0": K, "K1": K, "T_0to1": T},
        {"kind": "pose", "K0": K, "K1": K, "T_0to1": T},
        {"kind": "homography", "H": H},
        None,
    )
    pairs = listed("pairs", tmp_path)
    assert [pair.name for pair in pairs] == [f"pair/{k}" for k in range(7)]
    assert {(pair.left, pair.right) for pair in pairs} == {(tmp_path / "a.png", tmp_path / "b.png")}
    pfm, png, both, one, pose, plane, nothing = (pair.truth for pair in pairs)
    assert pfm == DisparityTruth(tmp_path / "d.pfm", 1.0)
    assert png == DisparityTruth(tmp_path / "d0.png", 256.0)
    assert isinstance(both, DepthTruth)
    assert (both.files, both.scale) == ((tmp_path / "d0.png", tmp_path / "d1.png"), 5000.0)
    assert (one.files, one.scale) == ((tmp_path / "d0.png", None), 1000.0)
    assert type(pose) is PoseTruth
    for truth in (both, one, pose):
        np.testing.assert_array_equal(truth.intrinsics, [OURS, OURS])
        np.testing.assert_array_equal(truth.pose, T)
    assert isinstance(plane, HomographyTruth)
    assert nothing is None


def test_a_homography_carries_pixel_centres_to_where_it_carried_them(tmp_path):
    write(tmp_path, {"kind": "homography", "H": H})
    (pair,) = listed("pairs", tmp_path)
    centres = np.array([[0.0, 0.0], [10, 20], [300, 7]])
    np.testing.assert_allclose(project(pair.truth.matrix, centres + 0.5), project(np.array(H), centres) + 0.5)


def test_a_gt_may_be_left_out_and_a_split_is_a_set(tmp_path):
    files(tmp_path, "a.png", "b.png")
    pair = {"left": "a.png", "right": "b.png"}
    entries = [{"name": "x", "set": "one", **pair}, {"name": "y", "set": "two", **pair}, {"name": "z", **pair}]
    file(tmp_path / "pairs.json", json.dumps(entries))
    assert [(pair.name, pair.truth) for pair in listed("pairs", tmp_path)] == [("x", None), ("y", None), ("z", None)]
    assert [pair.name for pair in listed("pairs", tmp_path, "two")] == ["y"]
    file(tmp_path / "pairs.json", json.dumps([{"name": "n", "set": 2024, **pair}, *entries]))
    assert [pair.name for pair in listed("pairs", tmp_path, "2024")] == ["n"]
    with pytest.raises(ConfigError, match=r"no set 'tow' \(did you mean 'two'\?\); sets are: 2024, one, two"):
        listed("pairs", tmp_path, "tow")


POSE = {"kind": "pose", "K0": K, "K1": K, "T_0to1": T}


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        ({"kind": "disparities", "file": "d.pfm"}, "kind 'disparities': write null or one of disparity, depth"),
        ("disparity", "kind None"),
        ({"kind": "disparity"}, "no 'file'"),
        ({"kind": "disparity", "file": "e.pfm"}, r"looked for .*e\.pfm"),
        ({"kind": "disparity", "file": "d.pfm", "scale": 0}, "scale 0: write a number above 0"),
        ({"kind": "disparity", "file": "d.pfm", "scale": None}, "scale None"),
        ({"kind": "disparity", "file": "d.pfm", "sign": 0}, "sign 0: write 1, or -1"),
        ({"kind": "disparity", "file": "d.pfm", "sign": "left"}, "sign 'left'"),
        ({"kind": "homography", "H": K[:2]}, "H of pair 'pair/0' of .* is no 3 x 3 matrix"),
        ({"kind": "homography", "H": [[1, 0, 0], [0, 1, 0], [0, 0, float("nan")]]}, "not finite"),
        ({"kind": "homography"}, "not finite|no 3 x 3"),
        ({**POSE, "K1": None}, "K1 of pair 'pair/0'"),
        ({**POSE, "K0": T}, "no 3 x 3 matrix"),
        ({**POSE, "K0": [[-500, 0, 1], [0, 500, 1], [0, 0, 1]]}, "not a calibration matrix"),
        ({**POSE, "T_0to1": T[:3]}, "no 4 x 4 matrix"),
        ({**POSE, "T_0to1": (2 * np.eye(4)).tolist()}, "not a rotation with a translation"),
        ({**POSE, "T_0to1": np.diag([1.0, 1, -1, 1]).tolist()}, "not a rotation with a translation"),
        ({**POSE, "kind": "depth"}, "no 'file'"),
        ({**POSE, "kind": "depth", "file": "d0.png", "file1": "no.png"}, r"looked for .*no\.png"),
    ],
)
def test_a_truth_that_cannot_be_used(tmp_path, truth, message):
    write(tmp_path, truth)
    with pytest.raises(InputError, match=message) as caught:
        listed("pairs", tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[{]", "not valid JSON.*line 1"),
        ('{"pairs": []}', "must hold a list"),
        ('["a"]', "must hold a list"),
        ("[]", "no pair found"),
        ('[{"left": "a.png", "right": "b.png"}]', "pair 0 .* no 'name'"),
        ('[{"name": "a", "left": "a.png"}]', "no 'right'"),
        ('[{"name": "a", "left": "a.png", "right": ["b.png"]}]', "no 'right'"),
        ('[{"name": "a", "left": "a.png", "right": "c.png"}]', r"looked for .*c\.png"),
        (b"\xff\xfe", "not a readable text"),
    ],
)
def test_a_list_that_cannot_be_used(tmp_path, content, message):
    files(tmp_path, "a.png", "b.png")
    file(tmp_path / "pairs.json", content)
    with pytest.raises(InputError, match=message):
        listed("pairs", tmp_path)


def test_two_pairs_of_one_name(tmp_path):
    write(tmp_path, None, None, name="same")
    with pytest.raises(InputError, match="two pairs named 'same'"):
        listed("pairs", tmp_path)


def test_csv(tmp_path):
    files(tmp_path, "l/1.png", "r/1.png", "l/2.png", "r/2.png", "d/2.png", "l/3, again.png")
    rows = [
        "left,right,disparity,scale",
        "l/1.png,r/1.png,,",
        "l/2.png, r/2.png,d/2.png,256",
        '"l/3, again.png",r/2.png',
    ]
    file(tmp_path / "pairs.csv", "\ufeff" + "\r\n".join(rows) + "\r\n")
    one, two, three = listed("csv", tmp_path)
    assert (one.name, one.left, one.right, one.truth) == ("l/1-1", tmp_path / "l/1.png", tmp_path / "r/1.png", None)
    assert (two.name, two.truth) == ("l/2-2", DisparityTruth(tmp_path / "d/2.png", 256.0))
    assert three.name == "l/3__again-2"


def test_csv_with_two_columns_and_with_names(tmp_path):
    files(tmp_path, "1.png", "2.png", "d.pfm")
    file(tmp_path / "pairs.csv", "left,right\n1.png,2.png\n")
    file(tmp_path / "named.csv", "name,left,right,disparity\nrun/1,1.png,2.png,d.pfm\n")
    assert [(pair.name, pair.truth) for pair in listed("csv", tmp_path)] == [("1-2", None)]
    (named,) = listed("csv", tmp_path, "named")
    assert (named.name, named.truth) == ("run/1", DisparityTruth(tmp_path / "d.pfm", 1.0))


def test_a_pair_in_the_order_right_left_says_its_sign(tmp_path):
    write(tmp_path, {"kind": "disparity", "file": "d.pfm", "sign": -1}, {"kind": "disparity", "file": "d.pfm"})
    file(tmp_path / "pairs.csv", "left,right,disparity,sign\na.png,b.png,d.pfm,-1\nb.png,a.png,d.pfm,\n")
    for name in ("pairs", "csv"):
        assert [pair.truth.sign for pair in listed(name, tmp_path)] == [-1, 1]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", r"columns : write left,right"),
        ("left;right\n1.png;2.png\n", r"columns left;right"),
        ("left,right,depth\n1.png,2.png,d.png\n", "left,right,depth"),
        ("left,right\n", "no pair found"),
        ("left,right\n1.png\n", "line 2 does not fit"),
        ("left,right\n1.png,2.png,3.png\n", "line 2 does not fit"),
        ("left,right\n1.png,9.png\n", r"looked for .*9\.png"),
        ("left,right,disparity,scale\n1.png,2.png,1.png,-1\n", "scale '-1'"),
        ("left,right,disparity\n1.png,2.png,d.pfm\n", r"looked for .*d\.pfm"),
    ],
)
def test_a_csv_that_cannot_be_used(tmp_path, content, message):
    files(tmp_path, "1.png", "2.png")
    file(tmp_path / "pairs.csv", content)
    with pytest.raises(InputError, match=message):
        listed("csv", tmp_path)


def test_isprs_by_file_order(tmp_path):
    files(tmp_path / "strip", "IMG_9.TIF", "IMG_10.TIF", "IMG_11.jpg", "readme.txt", ".IMG_12.tif")
    files(tmp_path / "other", "a.png", "b.png")
    pairs = listed("isprs", tmp_path)
    assert [pair.name for pair in pairs] == ["other/a-b", "strip/IMG_9-IMG_10", "strip/IMG_10-IMG_11"]
    assert [pair.truth for pair in pairs] == [None] * 3
    assert [pair.name for pair in listed("isprs", tmp_path, "other")] == ["other/a-b"]
    assert listed("isprs", tmp_path / "strip")[0].right == tmp_path / "strip/IMG_10.TIF"


def test_isprs_by_list(tmp_path):
    files(tmp_path, "1.tif", "2.tif", "cross/7.tif")
    file(tmp_path / "pairs.txt", "# across the strips\n1.tif cross/7.tif\n\n2.tif 1.tif  # backwards\n")
    pairs = listed("isprs", tmp_path)
    assert [(pair.left.name, pair.right.name) for pair in pairs] == [("1.tif", "7.tif"), ("2.tif", "1.tif")]
    file(tmp_path / "pairs.txt", "1.tif 3.tif\n")
    with pytest.raises(InputError, match=r"looked for .*3\.tif"):
        listed("isprs", tmp_path)
    file(tmp_path / "pairs.txt", "1.tif\n")
    with pytest.raises(InputError, match="line 1 has 1 words"):
        listed("isprs", tmp_path)


def test_isprs_with_one_photograph(tmp_path):
    files(tmp_path, "1.tif")
    with pytest.raises(InputError, match="two photographs in"):
        listed("isprs", tmp_path)


def test_unknown_names_are_answered_with_the_nearest(tmp_path):
    with pytest.raises(ConfigError, match=r"unknown data set 'kitti2016' \(did you mean 'kitti2015'\?\).*sceneflow"):
        open_dataset("kitti2016", tmp_path)
    with pytest.raises(ConfigError, match=r"unknown split of eth3d 'train' \(did you mean 'training'\?\)"):
        open_dataset("eth3d", tmp_path, "train")
    with pytest.raises(ConfigError, match=r"unknown option of sceneflow 'rendering' \(did you mean 'render'\?\)"):
        open_dataset("sceneflow", tmp_path, rendering="cleanpass")
    with pytest.raises(ConfigError, match=r"unknown option of csv 'gap'; known are: none"):
        open_dataset("csv", tmp_path, gap=3)


@pytest.mark.parametrize("name", DATASETS)
def test_a_root_that_is_no_folder(tmp_path, name):
    with pytest.raises(InputError, match=f"{name}: .*missing is not a folder"):
        open_dataset(name, tmp_path / "missing")
    with pytest.raises(InputError, match="is not a folder"):
        open_dataset(name, file(tmp_path / "file"))


@pytest.mark.parametrize("name", DATASETS)
def test_an_empty_root_is_opened_and_then_says_what_it_looked_for(tmp_path, name):
    dataset = open_dataset(name, tmp_path)
    assert dataset.name == name
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        next(dataset.pairs())


def test_listing_twice_gives_the_same(tmp_path):
    write(tmp_path, None, {"kind": "disparity", "file": "d.pfm"})
    dataset = open_dataset("pairs", tmp_path)
    first, second = ([(pair.name, pair.left, pair.truth) for pair in dataset.pairs()] for _ in range(2))
    assert first == second
    assert len(first) == 2


@given(st.lists(st.text(), min_size=1))
def test_a_name_is_a_path_below_any_folder(parts):
    name = layout.path_name(*parts)
    assert re.fullmatch(r"[A-Za-z0-9._/-]+", name)
    assert not {"", ".", ".."} & set(name.split("/"))


@given(st.text(st.sampled_from("ab²٣01_."), min_size=1), st.text(st.sampled_from("ab²٣01_."), min_size=1))
def test_natural_order_takes_any_name(a, b):
    first, second = (layout.natural(Path(f"x{name}")) for name in (a, b))
    assert (first < second) or (second < first) or (first == second)


def test_natural_order():
    names = ["scan10", "scan9", "scan009", "2", "a", "10"]
    assert sorted(names, key=lambda name: layout.natural(Path(name))) == ["2", "10", "a", "scan009", "scan9", "scan10"]


def test_the_documentation_names_every_data_set():
    rows = [line.split("|")[1:4] for line in (ROOT / "docs" / "datasets.md").read_text().splitlines() if "|" in line]
    for name, known in DATASETS.items():
        (row,) = [row for row in rows if f"`{name}`" in row[0]]
        assert row[1].strip() == known.truth
        assert [split for split in known.splits or () if f"`{split}`" not in row[2]] == []


def test_the_help_of_eval_names_every_data_set(run):
    code, out, _ = run("eval", "--help")
    assert code == 0
    assert [name for name in DATASETS if name not in out] == []


TOY = """
from zpm2.evaluate.datasets import dataset
from zpm2.evaluate.pairs import EvalPair


@dataset("toy", truth="none", splits=("first", "second"))
def pairs(root, split, *, backwards=False):
    left, right = (root / f"{split or 'first'}-{side}.png" for side in ("left", "right"))
    yield EvalPair("one", *((right, left) if backwards else (left, right)))
"""


def test_one_file_from_elsewhere_adds_a_data_set(tmp_path, monkeypatch, run):
    (tmp_path / "toy_dataset.py").write_text(TOY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "toy_dataset", raising=False)
    import_module("toy_dataset")
    try:
        files(tmp_path, "second-left.png", "second-right.png")
        (pair,) = listed("toy", tmp_path, "second", backwards=True)
        assert (pair.left.name, pair.right.name) == ("second-right.png", "second-left.png")
        with pytest.raises(ConfigError, match=r"unknown split of toy 'third'; known are: first, second"):
            open_dataset("toy", tmp_path, "third")
        assert "toy" in run("eval", "--help")[1]
        code, _, err = run("eval", "toys", "--root", tmp_path)
        assert code == 2
        assert "did you mean 'toy'?" in err
        with pytest.raises(ValueError, match="two data sets have the name 'toy'"):
            dataset("toy", truth="none")(lambda root, split: iter(()))
    finally:
        DATASETS.remove("toy")


def test_the_documented_pairs_are_read(tmp_path):
    page = (ROOT / "docs" / "datasets.md").read_text()
    (example,) = re.findall(r"^```json\n(.*?)^```", page, re.M | re.S)
    file(tmp_path / "pairs.json", example)
    for name in re.findall(r'"([^"]+\.(?:png|pfm|jpg|tif))"', example):
        file(tmp_path / name)
    kinds = [type(pair.truth) for pair in listed("pairs", tmp_path)]
    assert kinds == [DisparityTruth, DepthTruth, PoseTruth, HomographyTruth, type(None)]


def test_real_pairs():
    sample("pairs.json")
    entries = json.loads((SAMPLES / "pairs.json").read_text())
    pairs = listed("pairs", SAMPLES)
    assert [pair.name for pair in pairs] == [entry["name"] for entry in entries]
    kinds = {"disparity": DisparityTruth, "depth": DepthTruth, "pose": PoseTruth, "homography": HomographyTruth}
    for pair, entry in zip(pairs, entries, strict=True):
        assert type(pair.truth) is (kinds[entry["gt"]["kind"]] if entry["gt"] else type(None))
    assert len(listed("pairs", SAMPLES, "kitti")) == sum(entry["set"] == "kitti" for entry in entries)


def test_real_large_format():
    pairs = listed("isprs", sample("large_format"), "brighton_beach")
    assert [pair.name.split("/")[1] for pair in pairs] == [
        "DJI_0024-DJI_0025",
        "DJI_0025-DJI_0026",
        "DJI_0026-DJI_0027",
    ]
