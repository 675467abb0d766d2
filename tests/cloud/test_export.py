"""Files of a cloud, read back by other libraries."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from clouds import cloud_of, looking_down, squares
from meshes import grid

from zpm2 import memory
from zpm2.cloud import PolygonCloud, SurfaceMesh, export, save
from zpm2.errors import ConfigError

CAMERAS = [looking_down(-0.4, 0.1, 2.5), looking_down(0.4, -0.1, 2.5)]
OFFSET = np.array([1000.0, 2000.0, 30.0])


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> PolygonCloud:
    near = grid(12, seed=1)
    surface = SurfaceMesh.of(near.vertices + near.origin + OFFSET, near.faces)
    whole = squares(OFFSET)[0]
    part = whole.mean(0) + 0.5 * (whole - whole.mean(0))
    cameras = [looking_down(x, 0.1, 2.5, OFFSET) for x in (-0.4, 0.4)]
    return cloud_of(surface, [*squares(OFFSET), part], cameras, tmp_path_factory.mktemp("cloud"))


def test_cloud_json(cloud: PolygonCloud, tmp_path: Path) -> None:
    document = json.loads(cloud.save_json(tmp_path).read_text())
    assert document["schema"] == "zpm2-cloud/1"
    assert document["counts"]["patches"] == len(document["patches"]) == 10
    first = document["patches"][0]
    assert first["area"] == pytest.approx(0.09, rel=1e-3)
    assert first["views"] == [0, 1]
    assert np.array(first["rings"][0])[:, 2] == pytest.approx(30)
    assert first["normal"] == pytest.approx([0, 0, 1], abs=1e-6)
    assert document["patches"][9]["parent"] is not None
    assert [view["name"] for view in document["views"]] == ["0.png", "1.png"]
    for view in document["views"]:
        assert Path(view["path"]).is_absolute()
        assert (tmp_path / view["relative_path"]).samefile(view["path"])


def test_ply(cloud: PolygonCloud, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(export.write_ply(cloud, tmp_path / "p.ply"), process=False)
    assert len(mesh.faces) == sum(len(p.patch.faces) for p in cloud.patches)
    assert mesh.area == pytest.approx(sum(p.patch.area for p in cloud.patches), rel=1e-9)
    assert mesh.bounds[:, 2] == pytest.approx([30, 30])
    assert set(np.unique(mesh.metadata["_ply_raw"]["face"]["data"]["patch"])) == set(range(10))


def test_glb(cloud: PolygonCloud, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(export.write_glb(cloud, tmp_path / "c.glb"))
    names = set(scene.graph.nodes_geometry)
    assert {f"polygon {k}" for k in range(10)} | {f"boundary {k}" for k in range(10)} == names
    for patch in cloud.patches:
        mesh = scene.geometry[f"polygon {patch.id}"]
        assert mesh.area == pytest.approx(patch.patch.area, rel=1e-4)
        assert mesh.metadata["id"] == patch.id
        assert mesh.metadata["area"] == pytest.approx(patch.patch.area)
        assert scene.geometry[f"boundary {patch.id}"].is_watertight
    assert scene.metadata["origin"] == pytest.approx(OFFSET.tolist())


def test_boundaries(cloud: PolygonCloud, tmp_path: Path) -> None:
    files = export.write_boundaries(cloud, tmp_path)
    collection = json.loads(files[0].read_text())
    lines = files[1].read_text().splitlines()
    assert len(collection["features"]) == len(lines) == 10
    for feature, line, patch in zip(collection["features"], lines, cloud.patches, strict=True):
        shape = shapely.geometry.shape(feature["geometry"])
        number, text = line.split("\t")
        assert int(number) == feature["id"] == patch.id
        assert shape.has_z
        assert shapely.from_wkt(text).equals_exact(shape, 1e-9)
        assert shape.area == pytest.approx(patch.patch.area, rel=1e-6)  # they lie in a horizontal plane


@pytest.mark.parametrize("suffix", ["ply", "las"])
def test_points(cloud: PolygonCloud, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"points.{suffix}"
    if suffix == "las":
        laspy = pytest.importorskip("laspy")
    count = export.write_points(cloud, 0.01, path)
    assert count == pytest.approx(9 * 900, rel=0.05)  # those of a part are not those of its whole too
    if suffix == "las":
        las = laspy.read(path)
        at, ids, red = np.stack([las.x, las.y, las.z], axis=1), las.patch, las.red
        assert np.unique(red).tolist() == [90 * 257]
    else:
        trimesh = pytest.importorskip("trimesh")
        points = trimesh.load(path)
        at, ids = points.vertices, points.metadata["_ply_raw"]["vertex"]["data"]["patch"]
        assert points.colors[0].tolist()[:2] == [90, 120]
    assert at[:, 2] == pytest.approx(30, abs=1e-6)
    for patch in cloud.patches:
        ring = shapely.Polygon(cloud.world(patch.rings[0].points)[:, :2]).buffer(1e-6)
        mine = at[ids == patch.id]
        assert len(mine) > 50
        assert shapely.contains_xy(ring, mine[:, :2]).all()


@pytest.mark.parametrize(("spacing", "budget"), [(1e-6, "8GB"), (0.001, "16MB"), (1e-200, "none"), (np.nan, "none")])
def test_points_that_are_too_many(cloud: PolygonCloud, tmp_path: Path, spacing: float, budget: str) -> None:
    with memory.within(budget):
        with pytest.raises(ConfigError, match=f"spacing {spacing:g} makes more points .* or more") as error:
            save(cloud, tmp_path / "out", spacing)
        export.check_spacing(cloud, float(str(error.value).split()[-3]))
    assert not (tmp_path / "out").exists()


def test_everything_is_saved_and_nothing_else(
    cloud: PolygonCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("embreex")
    monkeypatch.setattr("zpm2.cloud.picture.SIZE", (160, 140))
    assert save(cloud, tmp_path / "out") == []
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        ".zpm2",
        *("cloud.json", "cloud.html", "cloud.png", "cloud.glb", "patches.ply", "points.ply"),
        *("boundaries.geojson", "boundaries.wkt"),
    }


def test_files_of_an_earlier_cloud_go(cloud: PolygonCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("laspy")
    monkeypatch.setattr("zpm2.cloud.picture.SIZE", (160, 140))
    out = tmp_path / "out"
    save(cloud, out, spacing=0.1, las=True)
    (out / "mine.txt").touch()
    for view in json.loads((out / "cloud.json").read_text())["views"]:
        assert (out / view["relative_path"]).is_file()
    save(cloud, out, spacing=0.1)
    assert (out / "points.ply").exists()
    assert not (out / "points.las").exists()
    save(dataclasses.replace(cloud, patches=[]), out)
    assert {path.name for path in out.iterdir()} == {".zpm2", "cloud.json", "mine.txt"}


def test_an_empty_cloud_can_be_saved(tmp_path: Path) -> None:
    empty = cloud_of(grid(6, size=0.1), squares()[:1], CAMERAS, tmp_path)
    assert not empty.patches
    save(empty, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "cloud.json").read_text())["patches"] == []
