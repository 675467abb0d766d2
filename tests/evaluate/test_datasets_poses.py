import json
from pathlib import Path

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from dataset_files import SAMPLES, file, listed, numbers, picture, sample
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from zpm2.errors import ConfigError, InputError
from zpm2.evaluate.pairs import DepthTruth, PoseTruth
from zpm2.formats import cameras

K = np.array([[1170.0, 0.0, 647.5], [0.0, 1168.0, 484.0], [0.0, 0.0, 1.0]])  # centres from 0, 1296 x 968 px
HALF = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # from centres at 0 to centres at +0.5
POINT = np.array([0.3, -0.2, 4.0])  # world, seen by every camera below


def camera(k: int) -> np.ndarray:
    """World to camera of view k: each one a little further right and turned."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("yx", [4 * k, -3 * k], degrees=True).as_matrix()
    pose[:3, 3] = (-0.1 * k, 0.02 * k, 0.05 * k)
    return pose


def seen(intrinsics: np.ndarray, pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(2,) where a camera sees a point, in the pixel convention of its `intrinsics`."""
    p = intrinsics @ (pose[:3, :3] @ point + pose[:3, 3])
    return p[:2] / p[2]


def carried(truth: PoseTruth, left: np.ndarray, depth: float) -> np.ndarray:
    """(2,) where the right image has what the left one has at `left` in that depth."""
    k0, k1 = truth.intrinsics
    ray = np.linalg.solve(k0, np.append(left, 1.0))
    return seen(k1, truth.pose, ray / ray[2] * depth)


def check(truth: PoseTruth, left_view: int, right_view: int, scale: float = 1.0, unit: float = 1.0) -> None:
    """The truth carries the world's point, seen by K at +0.5, from the left view to the right one.

    scale: of the stored picture to 1296 x 968; unit: of the world's length.
    """
    left, right = ((seen(K, camera(view), POINT) + 0.5) * scale for view in (left_view, right_view))
    depth = (camera(left_view)[:3, :3] @ POINT + camera(left_view)[:3, 3])[2] * unit
    np.testing.assert_allclose(carried(truth, left, depth), right, atol=1e-9)
    assert np.abs(left - right).max() > 5 * scale


def scannet(scene: Path, frames: list[int], width: int = 1296, height: int = 968, depth: bool = True) -> None:
    for view, frame in enumerate(frames):
        picture(scene / "color" / f"{frame}.jpg", width, height)
        file(scene / "pose" / f"{frame}.txt", numbers(np.linalg.inv(camera(view))))
        if depth:
            file(scene / "depth" / f"{frame}.png")
    four = np.eye(4)
    four[:3, :3] = K
    file(scene / "intrinsic" / "intrinsic_color.txt", numbers(four))
    four[0, 0] = 1.0  # not the one that counts
    file(scene / "intrinsic" / "intrinsic_depth.txt", numbers(four))


def test_scannet(tmp_path):
    scannet(tmp_path / "scene0707_00", [0, 10, 20])
    scannet(tmp_path / "scene0708_01", [0, 10])
    pairs = listed("scannet", tmp_path)
    assert [pair.name for pair in pairs] == ["scene0707_00/0-10", "scene0707_00/10-20", "scene0708_01/0-10"]
    scene = tmp_path / "scene0707_00"
    assert (pairs[1].left, pairs[1].right) == (scene / "color/10.jpg", scene / "color/20.jpg")
    truth = pairs[1].truth
    assert isinstance(truth, DepthTruth)
    assert truth.files == (scene / "depth/10.png", scene / "depth/20.png")
    assert truth.scale == 1000.0
    np.testing.assert_array_equal(truth.intrinsics[0], K + HALF)
    check(truth, 1, 2)
    assert [pair.name for pair in listed("scannet", tmp_path, "scene0708_01")] == ["scene0708_01/0-10"]
    assert [pair.name for pair in listed("scannet", scene)] == ["scene0707_00/0-10", "scene0707_00/10-20"]


def test_scannet_with_smaller_pictures_and_without_depth(tmp_path):
    scannet(tmp_path / "scans_test/scene0707_00", [0, 12], 648, 484, depth=False)
    (pair,) = listed("scannet", tmp_path)
    assert type(pair.truth) is PoseTruth
    check(pair.truth, 0, 1, 0.5)


def test_scannet_frames_stand_apart_in_the_order_of_their_numbers(tmp_path):
    scannet(tmp_path / "scene0000_00", [0, 5, 9, 10, 100, 110])
    assert [p.name.split("/")[1] for p in listed("scannet", tmp_path)] == ["0-10", "10-100", "100-110"]
    assert [p.name.split("/")[1] for p in listed("scannet", tmp_path, gap=100)] == ["0-100"]
    with pytest.raises(ConfigError, match="at least 1 frame, got 0"):
        listed("scannet", tmp_path, gap=0)


def test_scannet_frames_that_lost_tracking_take_no_part(tmp_path):
    scannet(tmp_path / "scene0000_00", [0, 10, 20])
    file(tmp_path / "scene0000_00/pose/10.txt", numbers(np.full((4, 4), -np.inf)))
    (pair,) = listed("scannet", tmp_path)
    assert pair.name == "scene0000_00/0-20"
    check(pair.truth, 0, 2)


@pytest.mark.parametrize("missing", ["pose/10.txt", "depth/10.png", "depth/0.png"])
def test_scannet_half_there(tmp_path, missing):
    scannet(tmp_path / "scene0000_00", [0, 10])
    (tmp_path / "scene0000_00" / missing).unlink()
    with pytest.raises(InputError, match=missing):
        listed("scannet", tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("pose/10.txt", "1 0 0", "holds 3 numbers, not 4 x 4"),
        ("pose/10.txt", "<html>", "words where numbers belong"),
        ("pose/10.txt", b"\xff\xfe\x00", "not a readable text"),
        ("pose/10.txt", numbers(np.diag([2.0, 1, 1, 1])), "not a rotation"),
        ("intrinsic/intrinsic_color.txt", numbers(np.zeros((4, 4))), "not a calibration matrix"),
        ("color/0.jpg", b"not a picture", "not a picture in a known format"),
    ],
)
def test_scannet_damaged(tmp_path, name, content, message):
    scannet(tmp_path / "scene0000_00", [0, 10])
    file(tmp_path / "scene0000_00" / name, content)
    with pytest.raises(InputError, match=message) as caught:
        listed("scannet", tmp_path)
    assert name in str(caught.value)


def loftr(root: Path, base: str = "scannet_test_1500", width: int = 1296, height: int = 968) -> None:
    pose = camera(1) @ np.linalg.inv(camera(0))
    np.savez(root / "test.npz", name=np.array([[707, 0, 15, 585]]), rel_pose=pose[:3].reshape(1, 12))
    small = np.diag([640 / 1296, 480 / 968, 1.0]) @ (K + HALF)
    np.savez(root / "intrinsics.npz", scene0707_00=small - HALF)
    for frame in (15, 585):
        picture(root / base / "scene0707_00" / "color" / f"{frame}.jpg", width, height)


@pytest.mark.parametrize("size", [(1296, 968), (648, 484)])
@pytest.mark.parametrize("base", ["", "scannet_test_1500", "scans_test"])
def test_scannet1500_by_the_index_of_loftr(tmp_path, base, size):
    loftr(tmp_path, base, *size)
    (pair,) = listed("scannet1500", tmp_path)
    assert pair.name == "scene0707_00/15-585"
    assert pair.right == tmp_path / base / "scene0707_00/color/585.jpg"
    assert type(pair.truth) is PoseTruth
    check(pair.truth, 0, 1, size[0] / 1296)


def test_scannet1500_with_depth(tmp_path):
    loftr(tmp_path)
    folder = tmp_path / "scannet_test_1500/scene0707_00/depth"
    file(folder / "15.png")
    with pytest.raises(InputError, match=r"depth/585\.png"):
        listed("scannet1500", tmp_path)
    file(folder / "585.png")
    (pair,) = listed("scannet1500", tmp_path)
    assert pair.truth.files == (folder / "15.png", folder / "585.png")


def superglue(root: Path, index: str, names: tuple[str, str]) -> None:
    pose = camera(1) @ np.linalg.inv(camera(0))
    words = [*names, "0", "0", *(repr(float(v)) for m in (K, K, pose) for v in m.ravel())]
    file(root / index, " ".join(words) + "\n\n")


@pytest.mark.parametrize(
    ("split", "index", "form", "place"),
    [
        (None, "scannet_test_pairs_with_gt.txt", "scans_test/{}/sens/frame-{:06d}.color.jpg", "{}"),
        ("test", "scannet_test_pairs_with_gt.txt", "scans_test/{}/sens/frame-{:06d}.color.jpg", None),
        ("sample", "scannet_sample_pairs_with_gt.txt", "{}_frame-{:06d}.jpg", "scannet_sample_images/{}"),
        ("sample", "scannet_sample_pairs_with_gt.txt", "{}_frame-{:06d}.jpg", "{}"),
    ],
)
def test_scannet1500_by_the_list_of_superglue(tmp_path, split, index, form, place):
    names = tuple(form.format("scene0707_00", frame) for frame in (15, 585))
    superglue(tmp_path, index, names)
    for name, frame in zip(names, (15, 585), strict=True):
        picture(tmp_path / (place.format(name) if place else f"scene0707_00/color/{frame}.jpg"), 1296, 968)
    (pair,) = listed("scannet1500", tmp_path, split)
    assert pair.name == "scene0707_00/15-585"
    check(pair.truth, 0, 1)


@pytest.mark.parametrize(
    ("missing", "looked"),
    [
        ("test.npz", r"test\.npz and .*scannet_test_pairs_with_gt\.txt"),
        ("intrinsics.npz", r"intrinsics\.npz"),
        ("scannet_test_1500/scene0707_00/color/585.jpg", r"scannet_test_1500/scene0707_00/color/585\.jpg"),
    ],
)
def test_scannet1500_half_there(tmp_path, missing, looked):
    loftr(tmp_path)
    (tmp_path / missing).unlink()
    with pytest.raises(InputError, match=looked):
        listed("scannet1500", tmp_path)


def test_scannet1500_damaged(tmp_path):
    loftr(tmp_path)
    whole = (tmp_path / "test.npz").read_bytes()
    (tmp_path / "test.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"test\.npz is damaged"):
        listed("scannet1500", tmp_path)
    np.savez(tmp_path / "test.npz", name=np.array([[707, 0, 15, 585]]))
    with pytest.raises(InputError, match="no 'rel_pose'"):
        listed("scannet1500", tmp_path)
    np.savez(tmp_path / "test.npz", name=np.array([[708, 0, 15, 585]]), rel_pose=np.eye(4)[None, :3])
    with pytest.raises(InputError, match="no 'scene0708_00'"):
        listed("scannet1500", tmp_path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("a.jpg b.jpg 0 0", "line 1 has 4 words, not 38"),
        (" ".join(["a.jpg", "b.jpg", *["0"] * 36]), "'a.jpg', no frame"),
        (" ".join(["scene0000_00_frame-1.jpg", "scene0000_00_frame-2.jpg", "1", *["0"] * 35]), "turned by 90"),
        (" ".join(["scene0000_00_frame-1.jpg", "scene0000_00_frame-2.jpg", *["x"] * 36]), "words where numbers"),
    ],
)
def test_scannet1500_list_damaged(tmp_path, line, message):
    file(tmp_path / "scannet_test_pairs_with_gt.txt", line)
    with pytest.raises(InputError, match=message):
        listed("scannet1500", tmp_path)


def mvsnet(scan: Path, views: int = 3) -> None:
    for view in range(views):
        file(scan / "images" / f"{view:08d}.jpg")
        text = f"extrinsic\n{numbers(camera(view))}\n\nintrinsic\n{numbers(K)}\n\n425.0 2.5\n"
        file(scan / "cams" / f"{view:08d}_cam.txt", text)
    file(scan / "pair.txt", "3\n0\n2 1 2346.41 2 2036.53\n1\n2 0 2346.41 2 1900.0\n2\n2 1 1900.0 0 1800.0\n")


def test_dtu_of_mvsnet(tmp_path):
    for scan in ("scan10", "scan9"):
        mvsnet(tmp_path / scan)
    file(tmp_path / "notes/readme.txt")
    pairs = listed("dtu", tmp_path)
    assert [pair.name for pair in pairs] == [
        "scan9/00000000-00000001",
        "scan9/00000002-00000001",
        "scan10/00000000-00000001",
        "scan10/00000002-00000001",
    ]
    assert pairs[1].left == tmp_path / "scan9/images/00000002.jpg"
    check(pairs[0].truth, 0, 1)
    check(pairs[1].truth, 2, 1)
    assert len(listed("dtu", tmp_path, "scan10")) == len(listed("dtu", tmp_path / "scan10")) == 2


def idr(scan: Path, file_name: str = "cameras.npz", views: int = 3) -> None:
    arrays = {}
    for view in range(views):
        picture(scan / "image" / f"{view:06d}.png")
        world = np.eye(4)
        world[:3] = -1.7 * K @ camera(view)[:3]  # a projection has no scale and no sign
        arrays[f"world_mat_{view}"] = world
        arrays[f"world_mat_inv_{view}"] = np.linalg.inv(world)
        arrays[f"scale_mat_{view}"] = np.array([[9.0, 0, 0, 1], [0, 9, 0, 2], [0, 0, 9, 3], [0, 0, 0, 1]])
    np.savez(scan / file_name, **arrays)


@pytest.mark.parametrize("file_name", ["cameras.npz", "cameras_sphere.npz"])
def test_dtu_of_idr_and_neus(tmp_path, file_name):
    idr(tmp_path / "scan65", file_name)
    pairs = listed("dtu", tmp_path)
    assert [pair.name for pair in pairs] == ["scan65/000000-000001", "scan65/000001-000002"]
    check(pairs[0].truth, 0, 1)
    check(pairs[1].truth, 1, 2)


@pytest.mark.parametrize("missing", ["cams/00000001_cam.txt", "images/00000002.jpg", "pair.txt"])
def test_dtu_of_mvsnet_half_there(tmp_path, missing):
    mvsnet(tmp_path / "scan1")
    (tmp_path / "scan1" / missing).unlink()
    with pytest.raises(InputError, match=missing):
        listed("dtu", tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("pair.txt", "3\n0\n10 1 2346.41", "cut short"),
        ("pair.txt", "<html>", "not a pair file"),
        ("cams/00000000_cam.txt", "extrinsic 1 0 0", "not an MVSNet camera file"),
        ("cams/00000001_cam.txt", "<html>", "not an MVSNet camera file"),
    ],
)
def test_dtu_of_mvsnet_damaged(tmp_path, name, content, message):
    mvsnet(tmp_path / "scan1")
    file(tmp_path / "scan1" / name, content)
    with pytest.raises(InputError, match=message):
        listed("dtu", tmp_path)


def test_dtu_of_idr_half_there(tmp_path):
    idr(tmp_path / "scan65")
    (tmp_path / "scan65/image/000001.png").unlink()
    with pytest.raises(InputError, match=r"2 images, .*cameras\.npz 3 cameras"):
        listed("dtu", tmp_path)


def test_no_scan_at_all(tmp_path):
    with pytest.raises(InputError, match=r"cams and .*cameras\.npz"):
        listed("dtu", tmp_path)
    with pytest.raises(InputError, match=r"scan8"):
        listed("dtu", tmp_path, "scan8")


unit = st.floats(-1, 1)


@given(
    hnp.arrays(float, 3, elements=st.floats(-3, 3)),
    hnp.arrays(float, 3, elements=unit),
    st.floats(100, 5000),
    st.floats(0.5, 2),
    st.floats(-1, 1),
    hnp.arrays(float, 2, elements=st.floats(0, 2000)),
    st.sampled_from([-30.0, -1.0, 1e-3, 1.0, 250.0]),
)
def test_a_projection_comes_apart_into_what_it_was_made_of(turn, shift, focal, aspect, skew, center, scale):
    k = np.array([[focal, skew, center[0]], [0, focal * aspect, center[1]], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
    found, camera_matrix = cameras.decompose(scale * k @ pose[:3])
    np.testing.assert_allclose(found, k, atol=1e-6)
    np.testing.assert_allclose(camera_matrix, pose, atol=1e-8)


@given(hnp.arrays(float, 3, elements=unit), st.floats(0.2, 3), st.floats(0.2, 3))
def test_resized_intrinsics_see_the_point_at_the_same_share_of_the_picture(point, x, y):
    k = cameras.intrinsics(K)
    size, new = (1000, 800), (1000 * x, 800 * y)
    ahead = np.eye(4)
    ahead[2, 3] = 3.0
    at = seen(k, ahead, point)
    np.testing.assert_allclose(seen(cameras.resized(k, size, new), ahead, point), at * [x, y])


def known(name: str) -> dict:
    entries = json.loads((SAMPLES / "pairs.json").read_text())
    return next(entry["gt"] for entry in entries if entry["name"] == name)


def agrees(truth: PoseTruth, gt: dict, tolerance: float) -> None:
    for k, key in zip(truth.intrinsics, ("K0", "K1"), strict=True):
        np.testing.assert_allclose(k - HALF, gt[key], atol=tolerance)
    np.testing.assert_allclose(truth.pose, gt["T_0to1"], atol=tolerance)


def test_real_dtu():
    first, second = listed("dtu", sample("dtu/scan118"))
    agrees(first.truth, known("dtu/scan118_0-1"), 1e-3)
    agrees(second.truth, known("dtu/scan118_1-2"), 1e-3)


def test_real_scannet():
    pairs = listed("scannet", sample("scannet/unimatch_4frames"), gap=18)
    (pair,) = pairs
    agrees(pair.truth, known("scannet/unimatch_0048-0066"), 1e-5)
    agrees(listed("scannet", pair.left.parents[1], gap=6)[0].truth, known("scannet/unimatch_0048-0054"), 1e-5)


def test_real_scannet1500(tmp_path):
    folder = sample("scannet/superglue_samples")
    there = {path.name for path in (folder / "scannet_sample_images").iterdir()}
    lines = (folder / "scannet_sample_pairs_with_gt.txt").read_text().splitlines()
    chosen = [line for line in lines if set(line.split()[:2]) <= there]
    file(tmp_path / "scannet_sample_pairs_with_gt.txt", "\n".join(chosen))
    (tmp_path / "scannet_sample_images").symlink_to(folder / "scannet_sample_images")
    pairs = listed("scannet1500", tmp_path, "sample")
    assert len(pairs) == 5
    for pair in pairs:
        scene, frames = pair.name.split("/")
        key = "-".join(f"{int(frame):06d}" for frame in frames.split("-"))
        agrees(pair.truth, known(f"scannet/{scene}_{key}"), 1e-9)


def test_real_list_of_scannet1500_is_whole(tmp_path):
    index = sample("scannet/superglue_samples/scannet_test_pairs_with_gt.txt")
    (tmp_path / index.name).symlink_to(index)
    picture_file = picture(tmp_path / "picture.jpg", 1296, 968)
    for name in {name for line in index.read_text().splitlines() for name in line.split()[:2]}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).symlink_to(picture_file)
    assert len(listed("scannet1500", tmp_path)) == 1500
