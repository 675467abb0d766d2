"""Every command reads what `zpm2 match` reads, and matches as it does."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import shapely
from rendered import Pair, Run

from zpm2.api import Matcher
from zpm2.config import RasterConfig, assign, preset
from zpm2.formats import read_image
from zpm2.model import Image, Mask
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter

rasterio = pytest.importorskip("rasterio")
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
SIFT = ("--set", "points.methods=sift", "--device", "cpu")


def deep(path: Path, rgb: np.ndarray) -> Path:  # type: ignore[type-arg]
    """Five bands of 16 bit, of which 2, 3 and 4 are the photograph and the others nothing."""
    noise = np.random.default_rng(len(path.stem)).integers(0, 3000, rgb.shape[:2])
    values = np.stack([noise, *np.moveaxis(rgb.astype(int) * 9 + 500, 2, 0), noise]).astype(np.uint16)
    shape = {"width": rgb.shape[1], "height": rgb.shape[0], "count": 5, "dtype": "uint16"}
    with rasterio.open(path, "w", driver="GTiff", **shape) as file:
        file.write(values)
    return path


class Squares:
    """A segmenter that minds no gap."""

    name = "squares"

    def segment(self, image: Image) -> list[Mask]:
        corners = [(x, y) for y in range(0, image.height - 39, 40) for x in range(0, image.width - 39, 40)]
        return [Mask(x, y, np.ones((40, 40), bool)) for x, y in corners]


@pytest.fixture
def photographs(pair: Pair, tmp_path: Path) -> tuple[Path, Path]:
    return deep(tmp_path / "left.tif", pair.scene.left), deep(tmp_path / "right.tif", pair.scene.right)


@pytest.fixture
def given_regions(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    """The regions are known, for commands that take none."""
    own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    monkeypatch.setattr("zpm2.api.Matcher", partial(Matcher, segmenter=own))


@pytest.mark.usefixtures("given_regions")
def test_pose(pair: Pair, photographs: tuple[Path, Path], run: Run, tmp_path: Path) -> None:
    scene = pair.scene
    k = f"{scene.f},{scene.f},{scene.cx},{scene.cy}"
    words = ["--K", k, "--bands", "2,3,4", "--set", "pose.crops=off", *SIFT]
    code, _, err = run("pose", *photographs, "-o", tmp_path / "out", *words)
    assert code == 0, err
    document = json.loads((tmp_path / "out" / "matches.json").read_text())
    assert document["config"]["raster"]["bands"] == [2, 3, 4]
    assert len(document["matches"]) > 30
    assert "stretched to 8 bit" in " ".join(document["notes"])
    rotation = np.array(json.loads((tmp_path / "out" / "pose.json").read_text())["pose"]["rotation"])
    assert np.degrees(np.arccos((np.trace(rotation) - 1) / 2)) < 0.5


@pytest.mark.usefixtures("given_regions")
def test_pose_in_tiles(pair: Pair, photographs: tuple[Path, Path], run: Run, tmp_path: Path) -> None:
    words = ["--K", "guess", "--bands", "2,3,4", "--set", "pose.crops=off", *SIFT]
    words += ["--set", "tiles.mode=on", "--set", "tiles.size=256"]
    code, _, err = run("pose", *photographs, "-o", tmp_path / "out", *words)
    assert code == 0, err
    assert len(MatchResult.load(tmp_path / "out").matches) > 30
    assert "stitch" in MatchResult.load(tmp_path / "out").timings


@pytest.mark.usefixtures("given_regions")
def test_cloud(pair: Pair, photographs: tuple[Path, Path], run: Run, tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    scene = pair.scene
    k = f"{scene.f},{scene.f},{scene.cx},{scene.cy}"
    words = ["--stereo", "--K", k, "--baseline", str(scene.baseline), "--bands", "2,3,4", *SIFT]
    code, _, err = run("cloud", *photographs, "-o", tmp_path / "out", *words)
    assert code == 0, err
    cloud = json.loads((tmp_path / "out" / "cloud.json").read_text())
    assert cloud["counts"]["patches"] > 15
    assert cloud["config"]["raster"]["bands"] == [2, 3, 4]


@pytest.mark.parametrize("method", ["shape-context", "idsc"])
def test_baselines(pair: Pair, photographs: tuple[Path, Path], run: Run, tmp_path: Path, method: str) -> None:
    regions = [word for word in pair.regions if word not in ("--points", "sift")]
    words = ["--method", method, "--bands", "3", "--gsd", "0.5", "--min-area-m2", "100", "--tiles", "on", *regions]
    code, _, err = run("match", *photographs, "-o", tmp_path / "out", *words)
    assert code == 0, err
    assert "baselines do not work in tiles" in err
    result = MatchResult.load(tmp_path / "out")
    assert min(polygon.area for polygon in result.left.polygons) >= 400
    assert (result.left.geo.gsd, result.right.geo.gsd) == (0.5, 0.5)


def test_bands_of_a_whole_pair_too(pair: Pair, photographs: tuple[Path, Path]) -> None:
    from zpm2.pipeline import PairMatcher

    config = assign(preset("paper"), ["points.methods=sift", "device=cpu", "raster.bands=2,3,4"])
    own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    result = PairMatcher(config, segmenter=own)(*photographs)
    assert result.left.image is not None
    assert np.array_equal(result.left.image.rgb, read_image(photographs[0], config=RasterConfig(bands=(2, 3, 4))).rgb)


@pytest.mark.parametrize("kind", ["png", "webp", "tif", "array", "picture"])
def test_nothing_is_found_where_a_photograph_is_transparent(pair: Pair, tmp_path: Path, kind: str) -> None:
    gap = np.zeros(pair.scene.left.shape[:2], bool)
    gap[60:200, 100:260] = True
    pair_ = []
    for name, rgb in (("left", pair.scene.left), ("right", pair.scene.right)):
        rgba = np.dstack([rgb, np.where(gap & (name == "left"), 0, 255).astype(np.uint8)])
        picture = PIL.Image.fromarray(rgba)
        if kind in ("array", "picture"):
            pair_.append(rgba if kind == "array" else picture)
            continue
        pair_.append(tmp_path / f"{name}.{kind}")
        picture.save(pair_[-1], **({"lossless": True, "exact": True} if kind == "webp" else {}))
    config = assign(preset("paper"), ["points.methods=sift", "device=cpu"])
    result = Matcher(config, segmenter=Squares())(*pair_)
    assert len(result.left.polygons) > 20
    assert max(polygon.shape.intersection(shapely.box(100, 60, 260, 200)).area for polygon in result.left.polygons) == 0
    x, y = result.points.left.astype(int).T
    assert len(result.points) > 100
    assert not gap[y, x].any()
    assert result.left.image is not None
    assert np.array_equal(result.left.image.valid, ~gap)
    assert result.right.image is not None
    assert result.right.image.valid is None
