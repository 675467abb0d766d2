"""Workspaces as programs and data sets leave them: the same two cameras in every format."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from clouds import looking_down
from scipy.spatial.transform import Rotation

from zpm2.cloud.workspace import find_mesh, read_views
from zpm2.errors import InputError
from zpm2.geometry import HALF_PIXEL
from zpm2.model import PosedCamera

CAMERAS = [looking_down(-0.5, 0.1, 2.5), looking_down(0.5, -0.1, 2.5)]


def photographs(folder: Path, names: tuple[str, ...] = ("0.png", "1.png")) -> None:
    folder.mkdir(parents=True)
    for name in names:
        PIL.Image.new("RGB", (640, 480)).save(folder / name)


def at_zero(camera: PosedCamera) -> np.ndarray:
    """K as files have it whose pixel centres are at 0."""
    return np.linalg.inv(HALF_PIXEL) @ camera.camera.matrix


def pose(camera: PosedCamera) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.rotation, camera.translation
    return matrix


def colmap_text(folder: Path) -> None:
    photographs(folder / "images")
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("# cameras\n1 PINHOLE 640 480 500 500 320 240\n")
    lines = ["# images"]
    for k, camera in enumerate(CAMERAS):
        x, y, z, w = Rotation.from_matrix(camera.rotation).as_quat().tolist()
        shift = " ".join(map(repr, camera.translation.tolist()))
        lines += [f"{k + 1} {w!r} {x!r} {y!r} {z!r} {shift} 1 {k}.png", ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")


def colmap_binary(folder: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    colmap_text(folder)
    model = folder / "sparse" / "0"
    (model / "points3D.txt").write_text("")
    read = pycolmap.Reconstruction(str(model))
    for file in model.iterdir():
        file.unlink()
    read.write_binary(str(model))


def idr(folder: Path) -> None:
    photographs(folder / "image")
    worlds = {f"world_mat_{k}": np.eye(4) for k in range(2)}
    for k, camera in enumerate(CAMERAS):
        worlds[f"world_mat_{k}"][:3] = at_zero(camera) @ pose(camera)[:3]
    np.savez(folder / "cameras.npz", **worlds)


def mvsnet(folder: Path) -> None:
    photographs(folder / "images")
    (folder / "cams").mkdir()
    for k, camera in enumerate(CAMERAS):
        rows = ["extrinsic", *(" ".join(map(repr, row)) for row in pose(camera).tolist()), "", "intrinsic"]
        rows += [*(" ".join(map(repr, row)) for row in at_zero(camera).tolist()), "", "425 2.5"]
        (folder / "cams" / f"{k}_cam.txt").write_text("\n".join(rows))


def strecha(folder: Path) -> None:
    photographs(folder / "images")
    (folder / "gt_dense_cameras").mkdir()
    for k, camera in enumerate(CAMERAS):
        values = [*at_zero(camera).ravel(), 0, 0, 0, *camera.rotation.T.ravel(), *camera.center, 640, 480]
        (folder / "gt_dense_cameras" / f"{k}.png.camera").write_text(" ".join(repr(float(v)) for v in values))


@pytest.mark.parametrize("write", [colmap_text, colmap_binary, idr, mvsnet, strecha])
def test_every_format_gives_the_same_cameras(write, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "scene"
    folder.mkdir()
    write(folder)
    views = read_views(folder)
    assert [view.name for view in views] == ["0.png", "1.png"]
    for view, camera in zip(views, CAMERAS, strict=True):
        assert view.path.is_file()
        assert view.camera.camera.matrix == pytest.approx(camera.camera.matrix, abs=1e-9)
        assert view.camera.rotation == pytest.approx(camera.rotation, abs=1e-9)
        assert view.camera.center == pytest.approx(camera.center, abs=1e-9)


def test_places_can_be_named(tmp_path: Path) -> None:
    (tmp_path / "scene").mkdir()
    idr(tmp_path / "scene")
    (tmp_path / "scene" / "image").rename(tmp_path / "photos")
    (tmp_path / "scene" / "cameras.npz").rename(tmp_path / "c.npz")
    views = read_views(tmp_path / "scene", tmp_path / "photos", tmp_path / "c.npz")
    assert len(views) == 2


def test_what_cannot_be_used_is_said(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    with pytest.raises(InputError, match=r"not a folder|neither a folder"):
        read_views(scene)
    photographs(scene / "images")
    with pytest.raises(InputError, match="no cameras in"):
        read_views(scene)
    (scene / "sparse").mkdir()
    (scene / "sparse" / "cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240\n")
    (scene / "sparse" / "images.txt").write_text("1 1 0 0 0 0 0 0 1 0.png\n\n")
    with pytest.raises(InputError, match="1 photographs"):
        read_views(scene)
    (scene / "sparse" / "images.txt").write_text("1 1 0 0 0 0 0 0 1 0.png\n\n2 1 0 0 0 0 0 0 1 gone.png\n\n")
    with pytest.raises(InputError, match=r"gone\.png"):
        read_views(scene)
    (scene / "sparse" / "images.txt").write_text("1 1 0 0 0 0 0 0 1 0.png\n\n2 1 0 0 0 0 0 0 1 1.png\n\n")
    PIL.Image.new("RGB", (64, 48)).save(scene / "images" / "1.png")
    with pytest.raises(InputError, match="64 x 48 px, its camera 640 x 480"):
        read_views(scene)


def test_the_mesh(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--mesh"):
        find_mesh(tmp_path)
    (tmp_path / "a.ply").touch()
    assert find_mesh(tmp_path).name == "a.ply"
    (tmp_path / "b.obj").touch()
    with pytest.raises(InputError, match=r"a\.ply, b\.obj"):
        find_mesh(tmp_path)
    (tmp_path / "mesh.ply").touch()
    assert find_mesh(tmp_path).name == "mesh.ply"


def test_photographs_in_sub_folders_that_the_model_names(tmp_path: Path) -> None:
    """Two of one name, each with its own camera; where nothing names them, the folders are said."""
    scene = tmp_path / "scene"
    for side, size in (("a", (640, 480)), ("b b", (320, 240))):
        (scene / "images" / side).mkdir(parents=True)
        PIL.Image.new("RGB", size).save(scene / "images" / side / "0.png")
    (scene / "sparse").mkdir()
    (scene / "sparse" / "cameras.txt").write_text(
        "1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 320 240 250 250 160 120\n3 FOV 9 9 1 1 1 1 1\n"
    )
    lines = "1 1 0 0 0 0 0 0 1 a/0.png\n\n\n2 1 0 0 0 -1 0 0 2 b b/0.png\n"
    (scene / "sparse" / "images.txt").write_text(lines)
    views = read_views(scene)
    assert [(view.name, view.camera.camera.size[0]) for view in views] == [("a/0.png", 640), ("b b/0.png", 320)]
    notes: list[str] = []
    (scene / "sparse" / "images.txt").write_text(lines + "\n3 1 0 0 0 -1 0 0 3 c/0.png\n")
    assert len(read_views(scene, notes=notes)) == 2
    assert "1 of 3 photographs have a camera of model FOV" in notes[0]
    (scene / "cams").mkdir()
    (scene / "cams" / "0_cam.txt").touch()
    with pytest.raises(InputError, match=r"images holds no photographs itself, .*images/a and 1 more sub-folders do"):
        read_views(scene, cameras=scene / "cams")


def test_cameras_that_do_not_fit(tmp_path: Path) -> None:
    """MVSNet's files have no size: a camera of half of it is said, one of the turned image and of none refused."""
    scene = tmp_path / "scene"
    scene.mkdir()
    mvsnet(scene)
    files = {file: file.read_text() for file in (scene / "cams").iterdir()}

    def written(fx: float, cx: float, cy: float) -> None:
        for file, text in files.items():
            file.write_text(f"{text.partition('intrinsic')[0]}intrinsic\n{fx} 0 {cx}\n0 {fx} {cy}\n0 0 1\n\n425 2.5")

    for values, why in (
        ((500, 239.5, 319.5), "fits 480 x 640"),
        ((500, 700, 240), "outside"),
        ((35, 320, 240), "in px"),
    ):
        written(*values)
        with pytest.raises(InputError, match=rf"the camera of 0\.png has .*{why}"):
            read_views(scene)
    written(250, 159.5, 119.5)
    notes: list[str] = []
    read_views(scene, notes=notes)
    assert notes == [
        "the camera of 0.png has its principal point at (160, 120), 25 % of a side from the middle of the image of "
        "640 x 480 px: was it made for another size? (and 1 more cameras)"
    ]
