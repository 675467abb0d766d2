"""Surfaces from rectified pairs, against exact ones."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from rendered import Pair

from zpm2.cloud.disparity_mesh import disparity_mesh
from zpm2.config import CloudConfig, StereoConfig
from zpm2.errors import Failed, InputError
from zpm2.model import Camera, Image
from zpm2.photos.images import read_image
from zpm2.stereo.calibration import read_calibration
from zpm2.stereo.dense import disparity_range, refuse_other_disparity, semi_global
from zpm2.stereo.rig import Rig, rig_of

K = np.array([[300.0, 0, 200], [0, 300, 120], [0, 0, 1]])


def rig(doffs: float = 0.0, size: tuple[int, int] = (400, 240)) -> Rig:
    right = K.copy()
    right[0, 2] += doffs
    return rig_of(Camera(K, size), Camera(right, size), 0.2)


@pytest.mark.parametrize("doffs", [0.0, 12.5])
def test_a_plane_is_one(doffs: float) -> None:
    """n X = 1 in space is linear in disparity."""
    x, y = np.meshgrid(np.arange(400) + 0.5, np.arange(240) + 0.5)
    n = np.array([0.05, -0.1, 0.3])
    inverse = n[0] * (x - 200) / 300 + n[1] * (y - 120) / 300 + n[2]  # 1 / Z
    surface = disparity_mesh((300 * 0.2 * inverse - doffs).astype(np.float32), rig(doffs), CloudConfig())
    assert len(surface.faces) == 2 * 399 * 239
    assert (surface.vertices + surface.origin) @ n == pytest.approx(1, abs=1e-4)


def test_it_is_torn_where_depth_jumps_and_open_where_nothing_is_known() -> None:
    disparity = np.full((40, 60), 10.0, np.float32)
    disparity[:, 30:] = 14.0
    disparity[10:20, 5:15] = np.nan
    surface = disparity_mesh(disparity, rig(size=(60, 40)), CloudConfig())
    depth = surface.corners[..., 2] + surface.origin[2]
    assert np.ptp(depth, axis=1).max() < 1e-9  # no triangle leads from one depth to the other
    assert len(surface.faces) == 2 * 39 * (29 + 29) - 2 * 11 * 11 + 4  # and half of each corner of the hole


def test_large_maps_are_thinned() -> None:
    config = CloudConfig(max_faces=1000)
    surface = disparity_mesh(np.full((120, 120), 10.0, np.float32), rig(size=(120, 120)), config)
    assert 500 < len(surface.faces) <= 1000


def test_nothing_known_is_refused() -> None:
    with pytest.raises(InputError, match="no surface"):
        disparity_mesh(np.full((40, 60), np.nan, np.float32), rig(size=(60, 40)), CloudConfig())


def test_semi_global_matching_of_the_rendered_pair(pair: Pair) -> None:
    truth = pair.scene.disparity
    low, high = int(truth.min()) - 4, int(truth.max()) + 4
    found = semi_global(read_image(pair.left), read_image(pair.right), low, high, StereoConfig())
    known = np.isfinite(found)
    error = np.abs(found - truth)[known]
    assert known.mean() > 0.6
    assert np.median(error) < 0.25
    assert (error > 2).mean() < 0.05
    # what the right image does not show is not invented
    assert known[pair.scene.occluded].mean() < 0.5 * known[~pair.scene.occluded].mean()


def test_what_holds_no_data_has_no_disparity(pair: Pair) -> None:
    truth = pair.scene.disparity
    low, high = int(truth.min()) - 4, int(truth.max()) + 4
    gap = np.zeros((240, 400), bool)
    gap[60:160, 150:250] = True
    left, right = read_image(pair.left), read_image(pair.right)
    without = [Image(np.where(gap[..., None], 0, image.rgb).astype(np.uint8), valid=~gap) for image in (left, right)]
    assert np.isnan(semi_global(without[0], right, low, high, StereoConfig())[gap]).all()
    found = semi_global(left, without[1], low, high, StereoConfig())
    x, y = np.meshgrid(np.arange(400), np.arange(240))
    there = np.clip(np.round(x - truth).astype(int), 0, 399)
    inside = gap[y, there] & gap[y, np.clip(there - 6, 0, 399)]
    assert np.isnan(found[inside]).mean() > 0.95


def test_negative_disparities_are_found_too(pair: Pair) -> None:
    """The right image moved by 100 px, as principal points that differ do."""
    left, right = read_image(pair.left), read_image(pair.right)
    moved = np.zeros_like(right.rgb)
    moved[:, 100:] = right.rgb[:, :-100]
    truth = pair.scene.disparity - 100
    found = semi_global(left, read_image(moved), int(truth.min()) - 4, int(truth.max()) + 4, StereoConfig())
    inside = np.isfinite(found) & (np.arange(400) < 290)
    assert inside.mean() > 0.3
    assert np.median(np.abs(found - truth)[inside]) < 0.25


def test_where_to_look() -> None:
    low, high = disparity_range(np.linspace(10, 50, 100), 400, StereoConfig())
    assert low <= 2
    assert high >= 58
    assert isinstance(disparity_range(np.ones(3), 400, StereoConfig()), Failed)
    assert "not a rectified pair" in str(disparity_range(np.linspace(-300, 300, 100), 400, StereoConfig()))


def test_calibration_of_middlebury(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text(
        "cam0=[999.4 0 294.2; 0 999.4 252.9; 0 0 1]\ncam1=[999.4 0 327.0; 0 999.4 252.9; 0 0 1]\n"
        "doffs=32.8\nbaseline=193.001\nwidth=741\nheight=497\nndisp=70\n"
    )
    found = read_calibration(file, (741, 497))
    assert found.offset == pytest.approx(32.8)
    assert found.left.matrix[0, 2] == pytest.approx(294.7)
    assert found.depth(20.0) == pytest.approx(999.4 * 193.001 / 52.8)
    assert np.isnan(found.depth(-40.0))
    file.write_text("cam0=[1 2; 3 4]\nbaseline=1\n")
    with pytest.raises(InputError, match="no calibration"):
        read_calibration(file, (741, 497))


@pytest.mark.parametrize("names", [("P2", "P3"), ("P_rect_02", "P_rect_03")])
def test_calibration_of_kitti(tmp_path: Path, names: tuple[str, str]) -> None:
    file = tmp_path / "calib.txt"
    k = "718.856 0 607.193 {} 0 718.856 185.216 {} 0 0 1 0.003"
    file.write_text(f"P0: 1 2 3\n{names[0]}: {k.format(45.38, -0.11)}\n{names[1]}: {k.format(-337.29, 2.37)}\n")
    found = read_calibration(file, (1241, 376))
    assert found.left.size == (1241, 376)
    assert found.left.matrix[0, 2] == pytest.approx(607.693)
    assert found.baseline == pytest.approx((45.38 + 337.29) / 718.856)
    file.write_text(f"{names[0]}: 1 2\n{names[1]}: 3\n")
    with pytest.raises(InputError, match="3 x 4"):
        read_calibration(file, (1241, 376))


def test_pairs_that_are_not_rectified_are_refused() -> None:
    other = K.copy()
    other[1, 2] += 40
    with pytest.raises(InputError, match="one cy"):
        rig_of(Camera(K, (400, 240)), Camera(other, (400, 240)), 1.0)
    with pytest.raises(InputError, match="one size"):
        rig_of(Camera(K, (400, 240)), Camera(K, (300, 240)), 1.0)
    bent = Camera(K, (400, 240), np.array([0.1, 0, 0, 0]))
    with pytest.raises(InputError, match="distortion"):
        rig_of(bent, bent, 1.0)


@pytest.mark.parametrize(
    ("fx", "fy", "cy", "said"),
    [
        (300.7, 300, 120, None),
        (300, 301.2, 120, None),
        (300, 300, 120.4, None),
        (301, 300, 120, r"rows differ by up to 0.0 px, its columns by 0.7 px"),
        (300, 302, 120, r"rows differ by up to 0.8 px, its columns by 0.0 px"),
        (300, 302, 119, r"rows differ by up to 1.8 px"),
    ],
)
def test_rows_of_a_rectified_pair_may_differ_by_half_a_pixel(fx: float, fy: float, cy: float, said: str | None) -> None:
    other = np.array([[fx, 0, 170], [0, fy, cy], [0, 0, 1]])
    with pytest.raises(InputError, match=said) if said else nullcontext():
        rig_of(Camera(K, (400, 240)), Camera(other, (400, 240)), 1.0)


@pytest.mark.parametrize("baseline", [0.0, -0.2, float("nan"), float("inf")])
def test_a_baseline_is_a_length(baseline: float, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="length above 0"):
        rig_of(Camera(K, (400, 240)), Camera(K, (400, 240)), baseline)
    (tmp_path / "calib.txt").write_text(
        f"cam0=[300 0 200; 0 300 120; 0 0 1]\ncam1=[300 0 200; 0 300 120; 0 0 1]\nbaseline={baseline}\n"
        "width=400\nheight=240\n"
    )
    with pytest.raises(InputError, match="length above 0"):
        read_calibration(tmp_path / "calib.txt", (400, 240))


def test_exchanged_photographs_are_said() -> None:
    with pytest.raises(InputError, match="behind the cameras: give the left photograph first"):
        disparity_mesh(np.full((40, 60), -10.0, np.float32), rig(size=(60, 40)), CloudConfig())


def test_a_map_of_another_scale_sign_or_kind_is_refused() -> None:
    """Homologous points tell, even if half of them are wrong."""
    rng = np.random.default_rng(0)
    truth = np.repeat(rng.uniform(8, 60, (6, 10)), 20, 0).repeat(20, 1).astype(np.float32)
    left = rng.uniform([0, 0], [200, 120], (80, 2))
    right = left - np.c_[truth[tuple(left[:, ::-1].astype(int).T)], np.zeros(80)]
    right[::2] = rng.uniform([0, 0], [200, 120], (40, 2))
    truth[:3] = np.nan
    refuse_other_disparity(truth, left, right)
    refuse_other_disparity(-truth, left[:9], right[:9])  # too few to tell
    for other in (truth * 4, -truth, truth / 256, 60 / truth):
        with pytest.raises(InputError, match="does not fit the matches"):
            refuse_other_disparity(other, left, right)


def test_calibration_of_kitti_with_its_size(tmp_path: Path) -> None:
    k = "718.856 0 607.193 {} 0 718.856 185.216 0 0 0 1 0"
    lines = f"P_rect_02: {k.format(0)}\nP_rect_03: {k.format(-337)}\nS_rect_02: 1.242000e+03 3.750000e+02\n"
    (tmp_path / "calib.txt").write_text(lines)
    assert read_calibration(tmp_path / "calib.txt", (1241, 376)).left.size == (1242, 375)
    (tmp_path / "calib.txt").write_text(lines.replace("e+03", "x"))
    with pytest.raises(InputError, match="S_rect_02"):
        read_calibration(tmp_path / "calib.txt", (1241, 376))


def test_the_range_of_the_search_is_configured() -> None:
    differences = np.linspace(10, 50, 100)
    exact = StereoConfig(outliers=0.0, range_margin=0.0, min_range_margin=2.0)
    assert disparity_range(differences, 400, exact) == (8, 52)
    assert isinstance(disparity_range(differences, 400, StereoConfig(max_range=0.1)), Failed)
