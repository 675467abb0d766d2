"""Photographs in, a workspace out, against a scene that is known exactly."""

from pathlib import Path

import boards
import numpy as np
import pytest
from rendered import Run
from scipy.spatial.transform import Rotation

from zpm2.cloud import SurfaceMesh, open_caster, read_views
from zpm2.config import Config, ReconstructConfig, StereoConfig
from zpm2.errors import Failed, InputError
from zpm2.files import record
from zpm2.model import Image, PosedCamera
from zpm2.reconstruct import Reconstruction, reconstruct
from zpm2.reconstruct.depth import agreed
from zpm2.stereo.dense import semi_global
from zpm2.stereo.rectify import rectify_views

pycolmap = pytest.importorskip("pycolmap")


def points() -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.c_[rng.uniform(-1.5, 1.5, (200, 2)), rng.uniform(2.9, 4.1, 200)]


@pytest.mark.parametrize("reverse", [False, True])
def test_rows_of_rectified_views_are_epipolar_lines(reverse: bool) -> None:
    a, b = boards.cameras()[0:3:2]
    a, b = (b, a) if reverse else (a, b)
    pair = rectify_views(a, b, points(), 0.15, StereoConfig())
    assert not isinstance(pair, Failed)
    left, right = pair.images(Image(boards.seen(a)[0]), Image(boards.seen(b)[0]))
    assert left.rgb.shape == right.rgb.shape
    disparity = semi_global(left, right, *pair.search, StereoConfig())
    depth, truth = pair.depth(disparity), boards.seen(a)[1]
    known = np.isfinite(depth)
    assert known.mean() > 0.5
    error = np.abs(depth - truth)[known] / truth[known]
    assert np.median(error) < 0.004
    assert (error > 0.05).mean() < 0.05


def test_views_that_cannot_be_rectified_say_why() -> None:
    a = boards.cameras()[1]
    forward = PosedCamera(boards.CAMERA, a.rotation, a.translation - [0, 0, 1.0])
    assert "along their axis" in str(rectify_views(a, forward, points(), 0.15, StereoConfig()))
    assert isinstance(rectify_views(a, a, points(), 0.15, StereoConfig()), Failed)
    turned = PosedCamera(boards.CAMERA, np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]), a.translation)
    assert isinstance(rectify_views(a, turned, points(), 0.15, StereoConfig()), Failed)


def test_depths_that_agree() -> None:
    maps = np.array(
        [[[1.0, 1.0, 5.0, np.nan]], [[1.001, 2.0, np.nan, np.nan]], [[3.0, 2.01, np.nan, np.nan]]], np.float32
    )
    two = agreed(maps, 0.01, 2)
    assert two[0, :2] == pytest.approx([1.0005, 2.005])
    assert np.isnan(two[0, 2:]).all()
    assert agreed(maps, 0.01, 1)[0, 2] == 5.0


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reconstruct")
    paths = boards.write(folder / "photographs")
    known = {path.name: camera for path, camera in zip(paths, boards.cameras(), strict=True)}
    made = reconstruct(paths, folder / "ws", Config(reconstruct=ReconstructConfig(poisson_depth=8)), known)
    assert made.registered == 4
    assert made.notes == ()
    return folder / "ws"


@pytest.fixture(scope="module")
def nested(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Photographs of one name, each in a folder of its own."""
    folder = tmp_path_factory.mktemp("nested")
    paths = [folder / "photos" / f"cam {k}" / "0.png" for k in range(3)]
    for path, made in zip(paths, boards.write(folder / "flat", 3), strict=True):
        path.parent.mkdir(parents=True)
        made.rename(path)
    return paths


def test_photographs_of_one_name_keep_their_folders(nested: list[Path], tmp_path: Path) -> None:
    known = dict(zip(("cam 0/0.png", "cam 1/0.png", "cam 2/0.png"), boards.cameras(3), strict=True))
    small = Config(reconstruct=ReconstructConfig(max_size=240, poisson_depth=8))
    made = reconstruct(nested, tmp_path / "ws", small, known)

    assert (made.registered, made.notes) == (3, ())
    for view, camera in zip(read_views(tmp_path / "ws"), boards.cameras(3), strict=True):
        assert view.camera.center == pytest.approx(camera.center, abs=1e-6)


def test_a_model_names_photographs_in_sub_folders(
    nested: list[Path], run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def told(paths: list[Path], out: Path, config: Config, known: dict[str, PosedCamera], tell: object) -> object:
        asked.append((paths, {name: camera.camera.focal for name, camera in known.items()}))
        return Reconstruction(3, 3, 100, ())

    monkeypatch.setattr("zpm2.reconstruct.reconstruct", told)
    cameras = [f"{k} SIMPLE_PINHOLE 480 360 {480 + k} 240 180" for k in range(3)]
    (tmp_path / "cameras.txt").write_text("\n".join(cameras))
    lines = [f"{k} 1 0 0 0 {k} 0 0 {k} cam {k}/0.png\n\n" for k in range(3)]
    (tmp_path / "images.txt").write_text("".join(lines))
    folder = nested[0].parent.parent
    code, _, err = run("reconstruct", folder, "--cameras", tmp_path, "-o", tmp_path / "ws")
    assert code == 0, err
    assert asked == [(nested, {"cam 0/0.png": 480, "cam 1/0.png": 481, "cam 2/0.png": 482})]


def test_options_and_settings_reach_the_reconstruction(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def told(paths: list[Path], out: Path, config: Config, known: None, tell: object) -> Reconstruction:
        asked.append(config)
        return Reconstruction(3, 3, 100, ())

    monkeypatch.setattr("zpm2.reconstruct.reconstruct", told)
    paths = boards.write(tmp_path / "photographs", 3)
    words = "--max-size", "300", "--sequence", "--set", "reconstruct.trim=5", "--set", "stereo.speckle=9"
    code, _, err = run("reconstruct", *paths, *words, "-o", tmp_path / "ws")
    assert code == 0, err
    assert asked[0].reconstruct == ReconstructConfig(max_size=300, ordered=True, trim=5.0)
    assert asked[0].stereo == StereoConfig(speckle=9)


def test_known_cameras_stay_and_the_surface_is_where_it_was(workspace: Path) -> None:
    views = read_views(workspace)
    for view, camera in zip(views, boards.cameras(), strict=True):
        assert view.camera.center == pytest.approx(camera.center, abs=1e-6)
    surface = SurfaceMesh.read(workspace / "mesh.ply")
    x, y = np.meshgrid(np.arange(20, 460, 5) + 0.5, np.arange(20, 340, 5) + 0.5)
    directions = views[1].camera.directions(np.c_[x.ravel(), y.ravel()])
    origin = np.broadcast_to(views[1].camera.center - surface.origin, directions.shape)
    hits = open_caster(surface).first_hits(origin, directions)
    truth = boards.seen(boards.cameras()[1])[1][20:340:5, 20:460:5].ravel()
    depth = (hits.point - origin) @ views[1].camera.rotation[2]
    assert hits.found.mean() > 0.6
    error = np.abs(depth - truth)[hits.found] / truth[hits.found]
    assert np.median(error) < 0.005


def test_a_second_run_does_nothing_again(workspace: Path) -> None:
    times = {path: path.stat().st_mtime_ns for path in workspace.rglob("*") if path.is_file()}
    paths = sorted((workspace.parent / "photographs").iterdir())
    known = {path.name: camera for path, camera in zip(paths, boards.cameras(), strict=True)}
    reconstruct(paths, workspace, Config(reconstruct=ReconstructConfig(poisson_depth=8)), known)
    assert {path: path.stat().st_mtime_ns for path in workspace.rglob("*") if path.is_file()} == times
    (workspace / "mesh.ply").unlink()  # as if it had been interrupted
    reconstruct(paths, workspace, Config(reconstruct=ReconstructConfig(poisson_depth=8)), known)
    assert (workspace / "mesh.ply").is_file()


def test_another_reconstruction_is_not_mixed_in(workspace: Path) -> None:
    paths = sorted((workspace.parent / "photographs").iterdir())
    with pytest.raises(InputError, match="other photographs"):
        reconstruct(paths[:3], workspace, Config(reconstruct=ReconstructConfig(poisson_depth=8)), {})


def test_cameras_are_found_where_none_are_known(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boards.coarse(monkeypatch)
    boards.write(tmp_path / "photographs", 4)
    code, out, err = run("reconstruct", tmp_path / "photographs", "-o", tmp_path / "ws", "--max-size", "320")
    assert code == 0, err
    assert "4 of 4 photographs oriented" in out
    views = read_views(tmp_path / "ws")
    centers = np.array([view.camera.center for view in views])
    truth = np.array([camera.center for camera in boards.cameras(4)])
    steps, expected = (np.linalg.norm(np.diff(c, axis=0), axis=1) for c in (centers, truth))
    assert steps / steps.sum() == pytest.approx(expected / expected.sum(), abs=0.03)
    assert (tmp_path / "ws" / "mesh.ply").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["nowhere"], "not there"),
        (["one", "--max-size", "5"], "at least 100 px"),
        (["one", "--neighbors", "0"], "at least 1"),
        (["one"], "1 photographs"),
        (["."], "holds no photographs itself, one do"),
        (["empty"], "holds no photographs ("),
        (["one", "--cameras", "none.npz"], "check the path"),
    ],
)
def test_one_line_for_what_cannot_be_used(
    words: list[str], why: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    boards.write(tmp_path / "one", 1)
    (tmp_path / "empty").mkdir()
    code, _, err = run("reconstruct", *words, "-o", "ws")
    assert code == 2
    assert why in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "ws").exists()


def test_a_surface_without_triangles_is_no_success(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boards.coarse(monkeypatch)
    boards.write(tmp_path / "photographs", 3)
    model = [f"{k} PINHOLE 480 360 480 480 240 180" for k in range(3)]
    (tmp_path / "cameras.txt").write_text("\n".join(model))
    posed = [(Rotation.from_matrix(c.rotation).as_quat(scalar_first=True), c.translation) for c in boards.cameras(3)]
    lines = [" ".join(map(str, (k, *turn, *shift, k, f"{k}.png"))) + "\n\n" for k, (turn, shift) in enumerate(posed)]
    (tmp_path / "images.txt").write_text("".join(lines))
    words = "reconstruct", tmp_path / "photographs", "--cameras", tmp_path, "--max-size", "160", "-o", tmp_path / "ws"
    for _ in range(2):  # a second run finds nothing that it could call finished
        code, out, err = run(*words)
        assert (code, out) == (2, "")
        assert "too far apart for a surface: no triangle is left; give" in err.splitlines()[-1]
        assert "a larger --max-size, and another folder" in err
        assert not (tmp_path / "ws" / "mesh.ply").exists()


HEADER = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nend_header\n"
EMPTY = b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n" + (
    b"element face 0\nproperty list uchar int vertex_indices\nend_header\n"
)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("fused.ply", HEADER % 0),
        ("fused.ply", HEADER % 5000 + bytes(2000)),
        ("fused.ply", b""),
        ("mesh.ply", EMPTY),
        ("mesh.ply", b""),
    ],
)
def test_what_is_there_and_unusable_is_made_again(workspace: Path, name: str, content: bytes) -> None:
    part = workspace / "part"
    part.write_bytes(content)
    record.move_into_place(part, workspace / name)  # as an earlier run would have
    paths = sorted((workspace.parent / "photographs").iterdir())
    known = {path.name: camera for path, camera in zip(paths, boards.cameras(), strict=True)}
    reconstruct(paths, workspace, Config(reconstruct=ReconstructConfig(poisson_depth=8)), known)
    assert (workspace / name).stat().st_size > 10_000


def test_each_step_checks_its_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = boards.write(tmp_path / "photographs", 3)
    known = {path.name: camera for path, camera in zip(paths, boards.cameras(3), strict=True)}
    config, ws = Config(reconstruct=ReconstructConfig(max_size=120, poisson_depth=6)), tmp_path / "ws"

    with monkeypatch.context() as patch:
        patch.setattr(pycolmap, "undistort_images", lambda folder, *_, **__: (folder / "images").mkdir(parents=True))
        with pytest.raises(InputError, match="undistorted only 0 of 3 photographs"):
            reconstruct(paths, ws, config, known)
    assert not (ws / "dense").exists()
    with monkeypatch.context() as patch:
        patch.setattr(pycolmap, "stereo_fusion", lambda file, *_, **__: file.write_bytes(HEADER % 7 + bytes(7 * 27)))
        with pytest.raises(InputError, match="the depth of 7 points: too few for a surface; give"):
            reconstruct(paths, ws, config, known)
    assert not (ws / "fused.ply").exists()
    with monkeypatch.context() as patch:
        patch.setattr(pycolmap, "poisson_meshing", lambda cloud, file, *_: None)
        with pytest.raises(InputError, match="no triangle is left"):
            reconstruct(paths, ws, config, known)
    assert not (ws / "mesh.ply").exists()
