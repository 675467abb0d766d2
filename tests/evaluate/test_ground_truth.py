import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import blobs, box, moved, pixels, result
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.errors import InputError
from zpm2.evaluate.ground_truth import (
    CoVisible,
    center_pairs,
    covisible,
    from_depth,
    from_disparity,
    from_homography,
    mutual_best,
    overlap,
)
from zpm2.evaluate.metrics import scores
from zpm2.evaluate.pairs import DepthTruth, DisparityTruth, HomographyTruth, PoseTruth

SHARED = Path(__file__).resolve().parents[3] / "shared"
TOOL, DATA = SHARED / "tools/score_pair.py", SHARED / "data"
SIZE = (120, 80)
K = np.array([[100.0, 0, 60], [0, 100, 40], [0, 0, 1]])


def cameras(tx=0.0, files=(Path("unread.png"), None), scale=1000.0):
    pose = np.eye(4)
    pose[0, 3] = tx
    return DepthTruth((K, K), pose, files, scale)


def test_disparity_moves_points_to_the_left_and_drops_what_leaves():
    points = from_disparity(np.full((80, 120), 10.25, np.float32), SIZE)
    assert len(points) == 80 * 110
    assert np.array_equal(points.left - points.right, np.tile([10.25, 0.0], (len(points), 1)))
    assert points.right[:, 0].min() >= 0
    assert set(np.unique(points.left % 1)) == {0.5}


def test_the_nearer_point_hides_the_farther_one_and_unknown_hides_nothing():
    disparity = np.zeros((10, 100), np.float32)
    disparity[:, 60:80] = 20
    points = from_disparity(disparity, (100, 10))
    seen = np.unique(points.left[:, 0] - 0.5).astype(int)
    assert seen.tolist() == [*range(40), *range(60, 100)]
    disparity[:, 60:80] = np.nan
    assert np.unique(from_disparity(disparity, (100, 10)).left[:, 0] - 0.5).tolist() == [*range(60), *range(80, 100)]


def test_a_right_image_of_another_size():
    points = from_disparity(np.full((80, 120), 0.5, np.float32), (50, 40))
    assert points.right.max(0).tolist() == [49.0, 39.5]
    assert points.left.max(0).tolist() == [49.5, 39.5]


def test_a_plane_seen_by_shifted_cameras_has_one_disparity():
    depth = np.full((80, 120), 4.0)
    by_depth = from_depth(depth, cameras(-0.4), SIZE)
    by_disparity = from_disparity(np.full((80, 120), 10.0), SIZE)  # f b / z
    assert np.array_equal(by_depth.left, by_disparity.left)
    assert by_depth.right == pytest.approx(by_disparity.right, abs=1e-9)


def test_depth_occlusion_by_z_buffer_and_by_the_right_depth():
    depth = np.full((80, 120), 4.0)
    depth[:, 60:80] = 1.0  # disparity 40 beside 10: hides columns 30 to 49
    for right_depth in (None, np.where(np.isin(np.arange(120), np.arange(20, 40)), 1.0, 4.0) * np.ones((80, 1))):
        seen = np.unique(from_depth(depth, cameras(-0.4), SIZE, right_depth).left[:, 0] - 0.5).astype(int)
        assert seen.tolist() == [*range(10, 30), *range(50, 120)]
    nowhere = from_depth(depth, cameras(-0.4), SIZE, np.full((80, 120), np.nan))
    assert len(nowhere) == 0


def test_points_behind_the_right_camera_do_not_count():
    behind = cameras()
    behind.pose[2, 3] = -5
    assert len(from_depth(np.full((80, 120), 4.0), behind, SIZE)) == 0


def test_homography_carries_pixel_centres():
    matrix = np.array([[1, 0, 5.0], [0, 1, -3.0], [0, 0, 1]])
    points = from_homography(matrix, SIZE, SIZE)
    assert len(points) == 115 * 77
    assert points.right - points.left == pytest.approx(np.tile([5.0, -3.0], (len(points), 1)))
    assert len(covisible(HomographyTruth(matrix), SIZE, SIZE)) == len(points)


def test_many_rows_are_read_in_blocks(monkeypatch):
    disparity = np.random.default_rng(0).uniform(0, 9, (80, 120)).astype(np.float32)
    polygons = blobs(np.random.default_rng(1), 9, SIZE)
    whole = from_disparity(disparity, SIZE)
    counts = overlap(polygons, polygons, whole, SIZE, SIZE).counts
    monkeypatch.setattr("zpm2.evaluate.ground_truth._BLOCK", 500)
    parts = from_disparity(disparity, SIZE)
    assert np.array_equal(whole.left, parts.left)
    assert np.array_equal(whole.right, parts.right)
    assert (overlap(polygons, polygons, parts, SIZE, SIZE).counts != counts).nnz == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_pair_in_the_order_right_left_sees_the_same_points(seed):
    """Mirrored images are those of the other order: x becomes width - x, and disparities change their sign."""
    rng = np.random.default_rng(seed)
    disparity = np.repeat(rng.uniform(1, 30, (8, 12)), 10, 0).repeat(10, 1)
    disparity[rng.random(disparity.shape) < 0.1] = np.nan
    there, back = from_disparity(disparity, SIZE), from_disparity(-disparity[:, ::-1], SIZE)
    mirror = np.array([SIZE[0], 0]), np.array([-1, 1])

    def rows(points):
        both = np.c_[points.left, points.right]
        return both[np.lexsort(both.T)]

    mirrored = CoVisible(mirror[0] + mirror[1] * back.left, mirror[0] + mirror[1] * back.right)
    assert rows(mirrored) == pytest.approx(rows(there), abs=1e-9)


def test_truth_in_the_order_right_left(tmp_path):
    """As stored, as the other sign of a map that cannot store it, and as SceneFlow, where the sign says nothing."""
    np.save(tmp_path / "d.npy", np.full((80, 120), -20.0))
    stored = covisible(DisparityTruth(tmp_path / "d.npy"), SIZE, SIZE)
    assert np.unique(stored.right - stored.left, axis=0).tolist() == [[20, 0]]
    cv2.imwrite(str(tmp_path / "d.png"), np.full((80, 120), 20, np.uint8))
    png = covisible(DisparityTruth(tmp_path / "d.png", sign=-1), SIZE, SIZE)
    assert np.array_equal(png.right, stored.right)
    flow = covisible(DisparityTruth(tmp_path / "d.npy", sign=0), SIZE, SIZE)
    assert np.unique(flow.right - flow.left, axis=0).tolist() == [[-20, 0]]


def test_truth_from_files(tmp_path):
    np.save(tmp_path / "d.npy", np.full((80, 120), 20.0))
    points = covisible(DisparityTruth(tmp_path / "d.npy", 2.0), SIZE, SIZE)
    assert len(points) == 80 * 110
    cv2.imwrite(str(tmp_path / "z.png"), np.full((80, 120), 4000, np.uint16))
    for other in (None, tmp_path / "z.png"):
        assert len(covisible(cameras(-0.4, (tmp_path / "z.png", other)), SIZE, SIZE)) == 80 * 110
    with pytest.raises(InputError, match=r"120 x 80 px, its image 121 x 80 px"):
        covisible(DisparityTruth(tmp_path / "d.npy"), (121, 80), SIZE)
    with pytest.raises(InputError, match="pose error"):
        covisible(PoseTruth((K, K), np.eye(4)), SIZE, SIZE)


def brute_iou(left, right, points, size):
    """(n, n') IoU by masks."""
    inside = []
    for polygons, where in ((left, points.left), (right, points.right)):
        masks = np.array([pixels(polygon, *size) for polygon in polygons]).reshape(-1, size[1], size[0])
        x, y = np.floor(where).astype(int).T
        inside.append(masks[:, y, x].astype(float))
    both = inside[0] @ inside[1].T
    return both / np.maximum(inside[0].sum(1)[:, None] + inside[1].sum(1) - both, 1)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_overlap_is_that_of_masks_and_the_best_are_mutual(seed):
    rng = np.random.default_rng(seed)
    left = blobs(rng, rng.integers(0, 12), SIZE)
    right = [moved(p, [-6 + rng.uniform(-2, 2), rng.uniform(-2, 2)], k) for k, p in enumerate(left)]
    right += blobs(rng, 3, SIZE, 50)
    disparity = np.where(rng.random((80, 120)) < 0.9, rng.uniform(4, 8, (80, 120)), np.nan)
    points = from_disparity(disparity, SIZE)
    overlaps = overlap(left, right, points, SIZE, SIZE)
    every = np.argwhere(np.ones((len(left), len(right)), bool))
    iou = brute_iou(left, right, points, SIZE)
    assert overlaps.iou(every) == pytest.approx(iou.ravel())
    last = None
    for t in (0.1, 0.4, 0.5, 0.8):
        best = mutual_best(overlaps, t)
        for i, j in best:
            assert iou[i, j] >= t
            assert iou[i, j] == pytest.approx(max(iou[i].max(), iou[:, j].max()))
        pairs = set(map(tuple, best.tolist()))
        assert last is None or pairs <= last
        last = pairs
    back = mutual_best(overlap(right, left, points.swapped(), SIZE, SIZE), 0.5)
    assert sorted(back[:, ::-1].tolist()) == mutual_best(overlaps, 0.5).tolist()


def test_pairs_that_truth_says_little_about_are_not_judged():
    disparity = np.full((80, 120), np.nan)
    disparity[10:14, 20:24] = 0
    points = from_disparity(disparity, SIZE)
    one = np.zeros((1, 2), int)
    small = [box(0, 18, 8, 26, 16)]
    assert not overlap(small, small, points, SIZE, SIZE).enough(one)[0]  # 16 points of at least 20
    disparity[10:15, 20:24] = 0
    points = from_disparity(disparity, SIZE)
    assert overlap(small, small, points, SIZE, SIZE).enough(one)[0]
    disparity[:40] = 0  # 4,800 of 9,600 px: half a point for a pixel on average
    points = from_disparity(disparity, SIZE)
    tree = [box(0, 30, 5, 60, 65)]  # 1050 of 1800 px
    crown = [box(0, 30, 36, 60, 76)]  # 120 of 1200 px, the rest is not measured
    assert overlap(tree, tree, points, SIZE, SIZE).enough(one)[0]
    assert not overlap(crown, crown, points, SIZE, SIZE).enough(one)[0]  # under 150, a quarter of the average
    assert len(mutual_best(overlap(crown, crown, points, SIZE, SIZE), 0.4)) == 0


def test_centres_that_project_onto_each_other():
    points = from_disparity(np.full((80, 120), 10.0), SIZE)
    left = [box(0, 20, 20, 60, 60), box(1, 70, 10, 90, 30), box(2, 0, 40, 8, 48)]
    right = [box(5, 60, 10, 80, 30), box(6, 12, 20, 52, 60), box(7, 90, 60, 100, 70)]
    assert center_pairs(left, right, points, SIZE, SIZE).tolist() == [[0, 1], [1, 0]]  # 2 px off of 4; exact; outside
    assert center_pairs(left, right, points, SIZE, SIZE, tolerance=0.04).tolist() == [[1, 0]]
    back = center_pairs(right, left, points.swapped(), SIZE, SIZE)
    assert sorted(back[:, ::-1].tolist()) == [[0, 1], [1, 0]]
    assert center_pairs([], right, points, SIZE, SIZE).shape == (0, 2)
    assert center_pairs(left, right, CoVisible(np.zeros((0, 2)), np.zeros((0, 2))), SIZE, SIZE).shape == (0, 2)


def test_a_hidden_centre_matches_nothing_and_the_nearest_partner_wins():
    disparity = np.full((80, 120), 10.0)
    disparity[30:50, 30:50] = np.nan
    left = [box(0, 20, 20, 60, 60)]
    right = [box(0, 10, 20, 50, 60), box(1, 12, 20, 52, 60)]
    size = SIZE, SIZE
    assert center_pairs(left, right, from_disparity(disparity, SIZE), *size).shape == (0, 2)
    assert center_pairs(left, right[::-1], from_disparity(np.full((80, 120), 10.0), SIZE), *size).tolist() == [[0, 1]]


def real_pair(name):
    entry = next(e for e in json.loads((DATA / "pairs.json").read_text()) if e["name"] == name)
    images = [cv2.imread(str(DATA / entry[side])) for side in ("left", "right")]
    return entry["gt"], *((image.shape[1], image.shape[0]) for image in images)


def real_depth(gt, second):
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    intrinsics = shift @ np.array(gt["K0"]), shift @ np.array(gt["K1"])
    files = DATA / gt["file"], DATA / gt["file1"] if second else None
    return DepthTruth(intrinsics, np.array(gt["T_0to1"]), files, gt["scale"])


CASES = {
    "pfm": ("middlebury/motorcycle_Q", False),
    "sceneflow": ("sceneflow/A-0032-0006", False),
    "png / 4": ("middlebury/cones", False),
    "lidar": ("kitti/2015_000046_10", False),
    "depth": ("rgbd/redwood_0-4", False),
    "two depths": ("rgbd/redwood_0-4", True),
}


@pytest.mark.skipif(not TOOL.exists() or not (DATA / "pairs.json").exists(), reason="needs the shared tool and data")
@pytest.mark.parametrize("case", CASES)
def test_scores_agree_with_the_independent_tool(case, tmp_path):
    name, second = CASES[case]
    gt, left_size, right_size = real_pair(name)
    truth = real_depth(gt, second) if gt["kind"] == "depth" else DisparityTruth(DATA / gt["file"], gt["scale"])
    rng = np.random.default_rng(7)
    points = covisible(truth, left_size, right_size)
    left = blobs(rng, 40, left_size, first_id=100)
    right = [moved(p, carried(p, points) + rng.uniform(-4, 4, 2), 2 * k) for k, p in enumerate(left)]
    right += blobs(rng, 10, right_size, first_id=500)
    ids = [(p.id, q.id) for p, q in zip(left, rng.permutation(right[:4]).tolist() + right[4:], strict=False)]
    found = result(left, right, ids[:30], left_size, right_size)
    (tmp_path / "matches.json").write_text(json.dumps(found.to_dict()))
    if gt["kind"] == "disparity":
        options = ["--disp", DATA / gt["file"], "--disp-scale", gt["scale"]]
    else:
        for file, matrix in (("K.txt", gt["K0"]), ("K2.txt", gt["K1"]), ("T.txt", gt["T_0to1"])):
            np.savetxt(tmp_path / file, matrix)
        options = ["--depth", DATA / gt["file"], "--scale", gt["scale"]]
        options += [part for name in ("K", "K2", "T") for part in (f"--{name}", tmp_path / f"{name}.txt")]
        options += ["--depth2", DATA / gt["file1"]] if second else []
    run = subprocess.run(
        [sys.executable, TOOL, tmp_path / "matches.json", *map(str, options)],
        capture_output=True,
        text=True,
        check=True,
    )
    theirs = [json.loads(line) for line in run.stdout.splitlines()]
    assert [line["iou"] for line in theirs] == [0.4, 0.5, 0.8]
    for ours, line in zip(scores(found, truth), theirs, strict=True):
        assert {key: value for key, value in ours.to_dict().items() if key != "AOR"} == pytest.approx(line, abs=1e-3)
    assert theirs[0]["good"] > 5
    assert theirs[0]["points"] == len(points)


def carried(polygon, points):
    """Where the middle of a polygon goes, px."""
    nearest = np.linalg.norm(points.left - polygon.center, axis=1).argmin()
    return points.right[nearest] - points.left[nearest]


def test_a_depth_map_of_another_resolution(tmp_path: Path) -> None:
    """As ScanNet's: the same view, fewer pixels. Other proportions are refused."""
    fine = np.repeat(np.repeat(np.arange(1, 13).reshape(3, 4), 40, axis=0), 40, axis=1).astype(np.float64)
    np.save(tmp_path / "fine.npy", fine)
    np.save(tmp_path / "coarse.npy", fine[20::40, 20::40])
    np.save(tmp_path / "wide.npy", fine[20::40, ::10])
    k = np.array([[100.0, 0, 80], [0, 100, 60], [0, 0, 1]])
    pose = np.eye(4)
    pose[0, 3] = -0.1
    found = {}
    for name in ("fine", "coarse"):
        truth = DepthTruth((k, k), pose, (tmp_path / f"{name}.npy", None), 1.0)
        found[name] = covisible(truth, (160, 120), (160, 120))
    assert len(found["fine"]) > 10_000
    assert np.array_equal(found["fine"].left, found["coarse"].left)
    assert np.array_equal(found["fine"].right, found["coarse"].right)
    with pytest.raises(InputError, match=r"16 x 3 px, its image 160 x 120 px"):
        covisible(DepthTruth((k, k), pose, (tmp_path / "wide.npy", None), 1.0), (160, 120), (160, 120))
