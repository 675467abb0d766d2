"""`zpm2 cloud` as people type it: a rectified pair, a workspace, and one line for what it cannot use."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rendered import Pair, Run, fewer
from scipy.spatial.transform import Rotation

from zpm2.cloud.disparity_mesh import disparity_mesh
from zpm2.cloud.export import write_surface
from zpm2.cloud.run import matching_part
from zpm2.config import CloudConfig, assign, preset
from zpm2.files.keys import key
from zpm2.files.record import make_folder, save_key
from zpm2.formats import claim
from zpm2.model import Camera
from zpm2.stereo.rig import Rig

pytest.importorskip("trimesh")
SIFT = ("--set", "points.methods=sift", "--device", "cpu")
SIFT_SETTINGS = ["points.methods=sift", "device=cpu"]


@pytest.fixture(autouse=True)
def _small_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zpm2.cloud.picture.SIZE", (160, 140))


@pytest.fixture(scope="module")
def rig(pair: Pair) -> Rig:
    scene = pair.scene
    camera = Camera(np.array([[scene.f, 0, scene.cx], [0, scene.f, scene.cy], [0, 0, 1]]), (400, 240))
    return Rig(camera, camera, scene.baseline)


@pytest.fixture(scope="module")
def matches(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from zpm2 import config
    from zpm2.pipeline import PairMatcher
    from zpm2.segment.given.precomputed import PrecomputedSegmenter

    chosen = config.assign(config.preset("default"), ["points.methods=sift", "device=cpu"])
    sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    return PairMatcher(chosen, segmenter=sides)(pair.left, pair.right).save(tmp_path_factory.mktemp("matches"))


@pytest.fixture(scope="module")
def few(matches: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A third of them."""
    return fewer(matches, tmp_path_factory.mktemp("few"), 20)


@pytest.fixture
def k(pair: Pair) -> str:
    return f"{pair.scene.f},{pair.scene.f},{pair.scene.cx},{pair.scene.cy}"


def depth_errors(document: dict, pair: Pair) -> np.ndarray:  # type: ignore[type-arg]
    """Of the boundaries' points against the exact depth, as a share of it; inside of the left image."""
    scene = pair.scene
    points = np.concatenate([np.array(ring) for patch in document["patches"] for ring in patch["rings"]])
    at = (points[:, :2] / points[:, 2:] * scene.f + [scene.cx, scene.cy]).astype(int)
    inside = (at >= 0).all(1) & (at < [400, 240]).all(1)
    points, at = points[inside], at[inside]
    truth = scene.f * scene.baseline / scene.disparity[at[:, 1], at[:, 0]]
    return np.abs(points[:, 2] - truth) / truth


def test_a_rectified_pair(pair: Pair, matches: Path, k: str, run: Run, tmp_path: Path) -> None:
    words = ("--stereo", "--K", k, "--baseline", "0.2", "--matches", matches, "-o", tmp_path / "out")
    code, out, err = run("cloud", pair.left, pair.right, *words)
    assert code == 0, err
    document = json.loads((tmp_path / "out" / "cloud.json").read_text())
    counts = document["counts"]
    assert counts["patches"] > 0.6 * counts["matches"]
    assert counts["accepted"] + counts["rejected"] == counts["matches"]
    assert f"{counts['patches']} polygons on the surface" in out
    assert np.median(depth_errors(document, pair)) < 0.02
    for name in ("cloud.html", "cloud.glb", "patches.ply", "points.ply", "boundaries.geojson", "mesh.ply"):
        assert (tmp_path / "out" / name).stat().st_size > 1000


def test_a_given_disparity(pair: Pair, few: Path, k: str, run: Run, tmp_path: Path) -> None:
    np.save(tmp_path / "disparity.npy", pair.scene.disparity)
    words = ("--stereo", "--K", k, "--baseline", "0.2", "--matches", few, "-o", tmp_path / "out")
    code, out, err = run("cloud", pair.left, pair.right, *words, "--disparity", tmp_path / "disparity.npy", "--json")
    assert code == 0, err
    counts = json.loads(out)["counts"]
    assert counts["accepted"] > 0.9 * counts["matches"]
    document = json.loads((tmp_path / "out" / "cloud.json").read_text())
    assert np.median(depth_errors(document, pair)) < 0.001


def test_a_disparity_with_its_sign_and_a_camera_that_hardly_fits(
    pair: Pair, few: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What does not fit the matches is refused, what is odd about K is said."""
    monkeypatch.setattr("zpm2.cloud.save", lambda *words: [])
    np.save(tmp_path / "d.npy", -4 * pair.scene.disparity)
    words = ("--stereo", "--baseline", "0.2", "--matches", few, "--disparity", tmp_path / "d.npy")
    odd = ("--K", f"{pair.scene.f},{pair.scene.f},120,60", "--disparity-scale", "4", "--disparity-sign", "-1")
    code, out, err = run("cloud", pair.left, pair.right, *words, *odd, "-o", tmp_path / "a", "--json")
    assert code == 0, err
    assert "the left camera has its principal point at (120, 60), 25 % of a side" in err
    assert any("principal point" in text for text in json.loads(out)["warnings"])
    centred = "--K", "300,300,200,120", "-o", tmp_path / "b"
    for more in ((), ("--disparity-scale", "4"), ("--disparity-sign", "-1")):
        code, _, err = run("cloud", pair.left, pair.right, *words, *centred, *more)
        assert code == 2
        assert "does not fit the matches" in err
        assert not (tmp_path / "b").exists()


@pytest.fixture(scope="module")
def surface(pair: Pair, rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The true surface as a mesh."""
    file = tmp_path_factory.mktemp("surface") / "mesh.ply"
    write_surface(disparity_mesh(pair.scene.disparity, rig, CloudConfig()), file)
    return file


@pytest.fixture
def workspace(pair: Pair, rig: Rig, surface: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "ws"
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (folder / "images").mkdir()
    for path in (pair.left, pair.right):
        shutil.copy(path, folder / "images" / path.name)
    camera = rig.left.matrix
    values = " ".join(repr(float(v)) for v in (camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]))
    (model / "cameras.txt").write_text(f"1 PINHOLE 400 240 {values}\n")
    lines = []
    for number, (path, view) in enumerate(zip((pair.left, pair.right), rig.views, strict=True), 1):
        x, y, z, w = Rotation.from_matrix(view.rotation).as_quat().tolist()
        shift = " ".join(map(repr, view.translation.tolist()))
        lines += [f"{number} {w} {x} {y} {z} {shift} 1 {path.name}", ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    shutil.copy(surface, folder)
    return folder


def with_matches(matches: Path, workspace: Path, out: Path) -> None:
    """The matches where an earlier run of the same workspace would have left them."""
    folder = make_folder(make_folder(claim(out, []) / "pairs") / "left-right")
    shutil.copy(matches / "matches.json", folder)
    photographs = [workspace / "images" / f"{side}.png" for side in ("left", "right")]
    save_key(folder, key(photographs, matching_part(assign(preset("default"), SIFT_SETTINGS))))


def test_a_workspace(pair: Pair, workspace: Path, few: Path, run: Run, tmp_path: Path) -> None:
    with_matches(few, workspace, tmp_path / "out")
    code, _, err = run("cloud", workspace, "-o", tmp_path / "out", *SIFT)
    assert code == 0, err
    document = json.loads((tmp_path / "out" / "cloud.json").read_text())
    assert document["counts"]["accepted"] > 0.9 * document["counts"]["matches"]
    assert [view["name"] for view in document["views"]] == ["left.png", "right.png"]
    assert np.median(depth_errors(document, pair)) < 0.001


def test_photographs_of_one_name_in_two_folders(
    workspace: Path, few: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """COLMAP's names may have folders; the matches of a pair are kept under both."""
    images = workspace / "images"
    for side in ("left", "right"):
        (images / side).mkdir()
        (images / f"{side}.png").rename(images / side / "0.png")
    model = workspace / "sparse" / "0" / "images.txt"
    model.write_text(model.read_text().replace("left.png", "left/0.png").replace("right.png", "right/0.png"))
    asked = []

    class Matcher:
        def __init__(self, *words: object, **named: object) -> None: ...

        def __call__(self, left: Path, right: Path) -> object:
            from zpm2.result import MatchResult

            asked.append((left, right))
            document = json.loads((few / "matches.json").read_text())
            document["left"]["path"], document["right"]["path"] = str(left), str(right)
            (tmp_path / "matches.json").write_text(json.dumps(document))
            return MatchResult.load(tmp_path)

    monkeypatch.setattr("zpm2.api.Matcher", Matcher)
    monkeypatch.setattr("zpm2.cloud.save", lambda *words: [])
    for _ in range(2):
        code, _, err = run("cloud", workspace, "-o", tmp_path / "out", *SIFT)
        assert code == 0, err
    assert asked == [(images / "left" / "0.png", images / "right" / "0.png")]  # the second run took what was there
    assert [p.name for p in (tmp_path / "out" / "pairs").iterdir()] == ["left_0-right_0"]


def test_non_overlapping(workspace: Path, matches: Path, run: Run, tmp_path: Path) -> None:
    with_matches(matches, workspace, tmp_path / "out")
    code, _, err = run("cloud", workspace, "-o", tmp_path / "out", "--non-overlapping", *SIFT)
    assert code == 0, err
    document = json.loads((tmp_path / "out" / "cloud.json").read_text())
    assert all(patch["parent"] is None for patch in document["patches"])


def test_a_mesh_in_another_frame(workspace: Path, rig: Rig, pair: Pair, run: Run, tmp_path: Path) -> None:
    from zpm2.cloud import SurfaceMesh

    mesh = disparity_mesh(pair.scene.disparity, rig, CloudConfig())
    away = SurfaceMesh.of(mesh.vertices + np.array([0, 0, -100.0]), mesh.faces)
    write_surface(away, tmp_path / "away.ply")
    code, _, err = run("cloud", workspace, "--mesh", tmp_path / "away.ply", "-o", tmp_path / "out", *SIFT)
    assert code == 2
    assert "same coordinates" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["nowhere"], "not a folder"),
        (["left.png", "right.png"], "one workspace, or two photographs"),
        (["left.png", "--stereo"], "one workspace, or two photographs"),
        (["left.png", "right.png", "--stereo"], "--calib, or --K and --baseline"),
        (["left.png", "right.png", "--stereo", "--K", "300,300,200,120", "--baseline", "-1"], "length above 0"),
        (["left.png", "right.png", "--stereo", "--calib", "none.txt"], "none.txt"),
        (["left.png", "right.png", "--stereo", "--K", "300,300,120,200", "--baseline", "1"], "fits 240 x 400 px"),
        (["left.png", "right.png", "--stereo", "--K", "300,300,900,120", "--baseline", "1"], "outside of the image"),
        (["left.png", "right.png", "--stereo", "--K", "35,35,200,120", "--baseline", "1"], "must be in px"),
        (["left.png", "right.png", "--stereo", "--calib", "small.txt"], "is for an image of 200 x 120 px, left.png"),
        (["left.png", "right.png", "--stereo", "--disparity-scale", "0"], "number above 0"),
        (["left.png", "right.png", "--stereo", "--disparity-sign", "2"], "give 1, or -1"),
        (["left.png", "right.png", "--stereo", "--disparity-sign", "1"], "--disparity-sign needs --disparity"),
        (["ws", "--disparity-scale", "1"], "--disparity-scale needs --disparity"),
        (["left.png", "right.png", "--stereo", "--mesh", "m.ply"], "--mesh is for a workspace: leave out --stereo"),
        (["ws", "--baseline", "1"], "--baseline needs --stereo"),
        (["ws", "--spacing", "0"], "distance above 0"),
        (["ws", "--mesh", "none.ply"], "does not exist"),
        (["ws", "--set", "cloud.step=0"], "above 0"),
    ],
)
def test_one_line_for_what_cannot_be_used(
    words: list[str],
    why: str,
    pair: Pair,
    workspace: Path,
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for path in (pair.left, pair.right):
        shutil.copy(path, tmp_path / path.name)
    camera = "[150 0 99.5; 0 150 59.5; 0 0 1]"
    Path("small.txt").write_text(f"cam0={camera}\ncam1={camera}\nbaseline=1\nwidth=200\nheight=120\n")
    code, _, err = run("cloud", *words, "-o", "out")
    assert code == 2
    assert why in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
