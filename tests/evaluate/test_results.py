"""Area matches of other tools: the readers, and their scores beside those of our own results."""

import json

import numpy as np
import PIL.Image
import pytest
import shapely
from rendered import Pair, Run
from result_files import box, dataset, labels, neutral, objects, rle

from zpm2.errors import ConfigError, InputError
from zpm2.evaluate.results.areas import as_result, sized_pair
from zpm2.evaluate.results.registry import RESULTS, ResultFormat, result_format
from zpm2.evaluate.run import Evaluation

PAIR = sized_pair("a/good", ((400, 240), (400, 240)))


def read(name, folder, pair=PAIR):
    return RESULTS.get(name).read(folder, pair)


def covered(pieces, size=(400, 240)):
    """(h, w) pixels of an area, by their centres."""
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    return shapely.contains_xy(shapely.union_all(pieces), x, y)


def write(folder, document, name="a/good"):
    file = folder / f"{name}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(document))
    return folder


def areas(*matches, **more):
    return {"schema": "zpm2-area-matches/1", "matches": list(matches), **more}


def match(left, right, score=1.0):
    return {"left": left, "right": right, "score": score}


def test_masks_of_either_kind_are_the_same_pixels(pair: Pair, tmp_path):
    found = read("areas", neutral(pair, tmp_path).parent.parent)
    left, right = labels(pair)
    assert found.seconds == 1.5
    assert len(found.matches) == 12
    for k, (a, b, score) in zip(objects(pair), found.matches, strict=True):
        assert np.array_equal(covered(a), left == k)
        assert np.array_equal(covered(b), right == k)
        assert score == 0.5


def test_boxes_and_polygons_in_a_frame_of_their_own(tmp_path):
    """As MESA gives them: boxes in photographs that were resized to 640 x 480."""
    ring = [[64, 48], [128, 48], [128, 96], [64, 96]]
    hole = [[80, 60], [80, 72], [112, 72], [112, 60]]
    document = areas(
        match({"box": [0, 0, 320, 240]}, {"polygon": [ring, hole]}, 7),
        left_size=[640, 480],
        right_size=[640, 480],
        left_areas=[{"box": [0, 0, 64, 48]}],
    )
    found = read("areas", write(tmp_path, document))
    ((left, right, score),) = found.matches
    assert left[0].bounds == (0, 0, 200, 120)
    assert right[0].area == pytest.approx((64 * 48 - 32 * 12) * (400 / 640) * (240 / 480))
    assert score == 1.0
    assert [len(side) for side in found.others] == [1, 0]
    assert found.others[0][0][0].bounds == (0, 0, 40, 24)


def test_an_area_in_several_pieces_and_in_several_matches(tmp_path):
    bits = np.zeros((240, 400), bool)
    bits[10:20, 10:30] = bits[50:90, 100:140] = True
    document = areas(*(match({"rle": rle(bits)}, {"box": [0, 0, 10 + k, 10]}) for k in range(2)))
    found = read("areas", write(tmp_path, document))
    result = as_result(found, PAIR.sizes)
    assert [m.left for m in result.matches] == [0, 1]
    first, second = result.left.polygons
    assert first.area == second.area == bits.sum()
    assert first.bounds == (100, 50, 140, 90)  # of the largest piece
    assert np.array_equal(covered([first.shape]), bits)


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ([], 'its "schema" must be "zpm2-area-matches/1"'),
        ({"schema": "other"}, 'its "schema" must be'),
        ({**areas(), "matches": {}}, '"matches" is no list'),
        (areas(3), "match 0 is no object"),
        (areas(match({"box": [0, 0, 5, 5]}, None)), "match 0, right: an area has one of box, polygon, rle, mask"),
        (areas(match({"box": [0, 0, 5]}, None)), "match 0, left: a box is four numbers"),
        (areas(match({"box": [5, 0, 0, 5]}, None)), "match 0, left is a box without area"),
        (areas(match({"polygon": [[[0, 0], [1, 1]]]}, None)), "has a ring of fewer than 3 points"),
        (areas(match({"polygon": [[[0, 0], [1, 1], [2, 2]]]}, None)), "match 0, left has no area"),
        (areas(match({"polygon": "x"}, None)), "a polygon is a list of rings"),
        (
            areas(match({"rle": {"size": [9, 9], "counts": [81]}}, None)),
            "is made for 9 x 9 px, the image has 400 x 240",
        ),
        (areas(match({"rle": 3}, None)), "has an RLE without its size"),
        (areas(match({"mask": "none.png"}, None)), "cannot read label image"),
        (areas(match({"mask": 3}, None)), "a mask is the name of a file"),
        (areas(match({"box": [0, 0, 5, 5]}, {"box": [0, 0, 5, 5]}, "high")), "match 0: its score is no number"),
        (areas(left_size=[0, 5]), '"left_size" is 0 x 5 px, which no image has'),
        (areas(right_size=3), '"right_size" must be \\[width, height\\]'),
        (areas(seconds="soon"), '"seconds" is no number'),
    ],
)
def test_neutral_files_that_cannot_be_used(tmp_path, document, complaint):
    with pytest.raises(InputError, match=complaint):
        read("areas", write(tmp_path, document))


def test_no_file_is_no_result(tmp_path):
    assert [read(name, tmp_path) for name in ("areas", "masa", "sam2")] == [None] * 3
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "good.json").write_bytes(b"{")
    with pytest.raises(InputError, match=r"good\.json cannot be read"):
        read("areas", tmp_path)


def frame(*objects, masks=None):
    """What MASA's inference_with_json.py writes for a frame: (id, box, score) each."""
    ids, boxes, scores = ([each[k] for each in objects] for k in range(3))
    return {"bboxes": boxes, "scores": scores, "labels": [0] * len(ids), "masks": masks, "instances_id": ids}


def test_masa_frames(tmp_path):
    bits = np.zeros((240, 400), bool)
    bits[5:9, 7:30] = True
    left = frame((3, [0, 0, 10, 10], 0.9), (4, [0, 0, 50, 50], 0.8), (9, [1, 1, 5, 5], 0.7))
    right = frame((4, [7, 5, 30, 9], 0.6), (8, [0, 0, 9, 9], 0.5), masks=[bits.tolist(), (~bits).tolist()])
    found = read("masa", write(tmp_path, [left, right]))
    ((a, b, score),) = found.matches
    assert a[0].bounds == (0, 0, 50, 50)
    assert np.array_equal(covered(b), bits)
    assert score == 0.6
    assert [len(side) for side in found.others] == [2, 1]
    assert read("masa", write(tmp_path, [frame(), frame()])).matches == []


def test_masa_tracks(tmp_path):
    def entry(image, track, x):
        return {"image_id": image, "track_id": track, "bbox": [x, 0, 10, 20], "score": 0.5, "category_id": 1}

    found = read("masa", write(tmp_path, [entry(8, 1, 40), entry(5, 1, 20), entry(5, 2, 0)]))
    ((left, right, _),) = found.matches
    assert (left[0].bounds, right[0].bounds) == ((20, 0, 30, 20), (40, 0, 50, 20))
    assert len(found.others[0]) == 1


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ({}, "is no list of frames or of boxes"),
        ([frame()] * 3, "has 3 frames, not two"),
        ([frame(), {"instances_id": "x"}], '"instances_id" are no numbers'),
        ([frame((1, [0, 0, 5], 1)), frame()], '"bboxes" are not 1 boxes'),
        ([frame((1, [0, 0, 5, 5], None)), frame()], '"scores" are not 1 numbers'),
        ([frame((1, [0, 0, 5, 5], 1), masks=[[[1]]]), frame()], "object 1: its mask is not 400 x 240 px"),
        ([frame((1, [0, 0, 5, 5], 1), masks=[1, 2]), frame()], '"masks" are not 1'),
        ([frame((1, [0, 0, 5, 5], 1), masks=3), frame()], '"masks" are not 1'),
        ([{"track_id": 1}], 'box 0: "image_id" is no number'),
        ([{"track_id": 1, "image_id": 1, "score": 1, "bbox": [0, 0, 1, 1]}], "has boxes of one image only"),
    ],
)
def test_masa_files_that_cannot_be_used(tmp_path, document, complaint):
    with pytest.raises(InputError, match=complaint):
        read("masa", write(tmp_path, document))


def test_sam2_one_picture_a_frame(tmp_path):
    home = tmp_path / "a" / "good"
    home.mkdir(parents=True)
    for k, name in enumerate(("00000.png", "00001.png")):
        ids = np.zeros((240, 400), np.uint8)
        ids[10:40, 10 + k : 50 + k] = 1
        ids[100:120, 100:150] = 2 + k
        picture = PIL.Image.fromarray(ids)
        picture.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0])  # as SAM 2 does
        picture.save(home / name)
    found = read("sam2", tmp_path)
    ((left, right, score),) = found.matches
    assert (left[0].bounds, right[0].bounds, score) == ((10, 10, 50, 40), (11, 10, 51, 40), 1.0)
    assert [len(side) for side in found.others] == [1, 1]
    PIL.Image.fromarray(np.zeros((9, 9), np.uint8)).save(home / "00001.png")
    with pytest.raises(InputError, match="is made for 9 x 9 px, the image has 400 x 240 px"):
        read("sam2", tmp_path)
    (home / "00001.png").unlink()
    with pytest.raises(InputError, match="has 1 frames of PNG masks, not two"):
        read("sam2", tmp_path)


def test_sam2_a_folder_for_each_object(tmp_path):
    for k in (1, 2):
        home = tmp_path / "a" / "good" / f"{k:03d}"
        home.mkdir(parents=True)
        for name in ("00000.png", "00001.png"):
            bits = np.zeros((240, 400), np.uint8)
            bits[10:40, 10:50] = k == 1 or name == "00000.png"  # both cover the same pixels; the second one leaves
            PIL.Image.fromarray(bits).save(home / name)
    found = read("sam2", tmp_path)
    assert len(found.matches) == 1
    assert [len(side) for side in found.others] == [1, 0]
    (tmp_path / "a" / "good" / "x").mkdir()
    with pytest.raises(InputError, match="its name must be a number"):
        read("sam2", tmp_path)


def test_the_scores_of_the_same_areas_are_ours(pair: Pair, run: Run, tmp_path):
    """The regions of the pair, written by us and read as another tool's, have the scores of a perfect method."""
    root = dataset(pair, tmp_path / "data", ("a/good", "b"))
    folder = neutral(pair, tmp_path / "theirs").parent.parent
    words = ["eval", "pairs", "--root", root, "-o", tmp_path / "out", "--results", "areas", folder]
    code, out, err = run(*words)
    assert code == 0, err
    assert "warning: b: missing" in err
    good, _ = Evaluation("pairs", root).score_results("areas", folder, tmp_path / "again")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (good["good"], good["scored"], good["gt"], good["matches"]) == (12, 12, 12, 12)
    assert good["P"] == good["R"] == good["MAS50"] == 1.0
    assert good["seconds"] == 1.5
    assert summary["good"] == 12
    assert (tmp_path / "out" / "rows.csv").read_bytes() == (tmp_path / "again" / "rows.csv").read_bytes()
    assert "Written" in out


def test_boxes_cover_more_than_they_match(pair: Pair, tmp_path):
    left, right = labels(pair)
    found = areas(*(match({"box": box(left == k)}, {"box": box(right == k)}) for k in objects(pair)))
    folder = write(tmp_path / "theirs", found)
    (row,) = Evaluation("pairs", dataset(pair, tmp_path / "data")).score_results("areas", folder, tmp_path / "out")
    assert row["scored"] == 12
    assert row["good"] > 8
    assert row["seconds"] is None


def test_an_area_that_reaches_far_outside_is_cut_off_at_the_border(pair: Pair, tmp_path):
    far = {"box": [-1e9, -1e9, 1e9, 1e9]}
    folder = write(tmp_path / "theirs", areas(match(far, far)))
    (row,) = Evaluation("pairs", dataset(pair, tmp_path / "data")).score_results("areas", folder, tmp_path / "out")
    assert (row["status"], row["scored"], row["AOR"]) == ("ok", 1, 1.0)


def test_misuse(pair: Pair, run: Run, tmp_path):
    root = dataset(pair, tmp_path / "data")
    words = ["eval", "pairs", "--root", root, "-o", tmp_path / "out", "--results"]
    (tmp_path / "empty").mkdir()
    for more, complaint in (
        (["areas", tmp_path / "none"], "none is no folder"),
        (["areas", tmp_path / "empty"], "holds no results of any of 1 pairs: areas are read from NAME.json in it"),
        (["areass", tmp_path / "empty"], "unknown result format 'areass' (did you mean 'areas'?)"),
        (["areas", tmp_path / "empty", "--method", "idsc"], "leave out --method, --regions and --score-only"),
    ):
        code, _, err = run(*words, *more)
        assert code == 2
        assert complaint in err.splitlines()[-1]
    write(tmp_path / "bad", {"schema": "other"})
    code, _, err = run(*words, "areas", tmp_path / "bad")
    assert code == 0
    assert "a/good: " in err
    assert 'its "schema" must be' in err


def test_a_format_of_ones_own():
    def mine(folder, pair):
        return None

    with pytest.raises(ValueError, match="two result formats have the name 'masa'"):
        result_format("masa", where="")(mine)
    result_format("mine", where="NAME.txt")(mine)
    assert RESULTS.get("mine") == ResultFormat("mine", mine, "NAME.txt")
    RESULTS.remove("mine")
    with pytest.raises(ConfigError, match="unknown result format 'mine'"):
        RESULTS.get("mine")
