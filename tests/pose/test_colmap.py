"""What COLMAP's own library reads back of a database and a model."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from test_relative import PLAIN, found
from views import camera, matched, views

from zpm2.errors import InputError, MissingDependency
from zpm2.formats.colmap import read_cameras, read_model
from zpm2.pose import PoseFinder, colmap

pycolmap = pytest.importorskip("pycolmap")
NAMES = ("a.png", "b.png")


def test_model(tmp_path: Path) -> None:
    of = views(0)
    result = found(of).with_baseline(float(np.linalg.norm(of.translation)))
    folder = colmap.write(result, NAMES, tmp_path / "colmap")
    model = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    assert {image.name for image in model.images.values()} == set(NAMES)
    right = model.find_image_with_name("b.png").cam_from_world()
    assert np.allclose(right.rotation.matrix(), of.rotation, atol=1e-4)
    assert np.allclose(right.translation, of.translation, atol=1e-3)
    assert model.num_points3D() == result.inliers.sum()
    point = next(iter(model.points3D.values()))
    row = point.track.elements[0].point2D_idx
    assert np.allclose(point.xyz, of.world[row], rtol=1e-2, atol=1e-2)
    assert model.compute_mean_reprojection_error() < 0.05


def test_database(tmp_path: Path) -> None:
    result = found(views(0, noise=0.2, outliers=0.2))
    for _ in range(2):  # a second run replaces the first
        folder = colmap.write(result, NAMES, tmp_path / "colmap")
    database = pycolmap.Database.open(str(folder / "database.db"))
    assert (database.num_cameras(), database.num_images()) == (2, 2)
    assert np.allclose(database.read_keypoints(1), result.points.points.left.astype(np.float32))
    assert len(database.read_two_view_geometry(1, 2).inlier_matches) == result.inliers.sum()
    database.close()


@pytest.mark.parametrize("bent", [(), (-0.1, 0.01, 0.001, 0.0), (-0.1, 0.01, 0.001, 0.0, 0.003)])
def test_cameras_there_and_back(bent: tuple[float, ...], tmp_path: Path) -> None:
    cameras = camera(700.0, distortion=np.array(bent)), camera(650.0, distortion=np.array(bent))
    of = views(0, cameras=cameras)
    folder = colmap.write(PoseFinder(PLAIN)(matched(of), cameras), NAMES, tmp_path)
    back = read_cameras(folder / "sparse" / "0")
    for name, original in zip(NAMES, cameras, strict=True):
        assert np.allclose(back[name].matrix, original.matrix)
        assert np.allclose(back[name].rays(of.points.left), original.rays(of.points.left))


def test_what_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="translation"):
        colmap.write(found(views(0, shift=(0, 0, 0))), NAMES, tmp_path)
    with pytest.raises(InputError, match="names that differ"):
        colmap.write(found(views(0)), ("a.png", "a.png"), tmp_path)
    monkeypatch.setitem(__import__("sys").modules, "pycolmap", None)
    with pytest.raises(MissingDependency, match=r'pip install "zpm2\[colmap\]"'):
        colmap.write(found(views(0)), NAMES, tmp_path)
    assert not list(tmp_path.iterdir())


def test_names_with_lines_of_their_own_stay_names(tmp_path: Path) -> None:
    """What would be two lines of a text model is one name of a binary one, and of the database."""
    names = "a.png\n2 1 0 0 0 0 0 0 1 b.png", "=1+1'; DROP TABLE images; --.png"
    folder = colmap.write(found(views(0)), names, tmp_path)
    assert set(read_model(folder / "sparse" / "0").images) == set(names)
    with sqlite3.connect(folder / "database.db") as base:
        assert {name for (name,) in base.execute("SELECT name FROM images")} == set(names)
