"""The script for large photographs, on small made-up ones: mosaics, the check of matches, growth, the two searches."""

import contextlib
import io
import json
import runpy
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from zpm2 import MatchResult
from zpm2.config import preset
from zpm2.errors import Failed
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "large_format.py"
MAP = np.array([[1.02, 0.03, -20.0], [-0.02, 0.98, 12.0]])  # left px -> right px


def run(*words: object) -> str:
    """What the script prints; in this process, as one of its own takes seconds to begin."""
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr("sys.argv", [str(SCRIPT), *map(str, words)])
        patch.syspath_prepend(SCRIPT.parent)
        runpy.run_path(str(SCRIPT), run_name="__main__")
    return printed.getvalue()


def rows(text: str) -> list[dict[str, str]]:
    """Of the first table."""
    lines = text[text.index("|") :].split("\n\n")[0].splitlines()
    cells = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines if line.startswith("|")]
    return [dict(zip(cells[0], each, strict=True)) for each in cells[2:]]


def noise(width: int, height: int, seed: int) -> NDArray[np.uint8]:
    gray = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    gray = cv2.GaussianBlur(gray, (0, 0), 2)
    return np.repeat(np.clip(128 + 40 * gray / gray.std(), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def mapped(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points @ MAP[:, :2].T + MAP[:, 2])


def saved(
    folder: Path,
    sides: list[ImagePolygons],
    partners: list[int],
    points: PointMatches,
    homography: NDArray[np.float64] | Failed,
) -> Path:
    """A result, in its folder; `partners` are those of the left polygons, in their order."""
    return MatchResult(
        left=sides[0],
        right=sides[1],
        matches=[PolygonMatch(a, b, 0.9, 1.0, 9, "global") for a, b in enumerate(partners)],
        points=points,
        fundamental=Failed("a plane"),
        homography=homography,
        config=preset("default").to_dict(),
        timings={},
    ).save(folder)


@pytest.fixture
def result(tmp_path: Path) -> Path:
    """Squares on noise, and one on a blank part; the partners of 3 and 4 are each other's."""
    left = noise(700, 500, 0)
    left[330:, 480:] = 128
    to_centers = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    matrix = (to_centers @ np.vstack([MAP, [0, 0, 1]]) @ np.linalg.inv(to_centers))[:2]
    right = cv2.warpAffine(left, matrix, (700, 500), borderMode=cv2.BORDER_CONSTANT, borderValue=(128, 128, 128))
    sides, at = [], np.random.default_rng(1).uniform((30, 30), (670, 470), (400, 2))
    corners = [(80, 80), (240, 90), (420, 100), (100, 280), (280, 290), (600, 420)]
    rings = [np.array([[x, y], [x + 60, y], [x + 60, y + 50], [x, y + 50]], float) for x, y in corners]
    for name, image, move in (("left", left, lambda p: p), ("right", right, mapped)):
        path = tmp_path / f"{name}.png"
        cv2.imwrite(str(path), image)
        sides.append(ImagePolygons(700, 500, [Polygon(k, move(ring)) for k, ring in enumerate(rings)], str(path)))
    points = PointMatches(at, mapped(at), np.ones(len(at)))
    homography = np.vstack([MAP, [0, 0, 1]])
    return saved(tmp_path / "result", sides, [0, 1, 2, 4, 3, 5], points, homography)


def test_matches_are_judged_by_features_alone(result: Path, tmp_path: Path) -> None:
    text = run("precision", result, "--sheet", tmp_path / "sheet.png")
    judged = {m["left"]: m for m in json.loads((result / "precision.json").read_text())["matches"]}
    assert all(judged[k]["iou"] > 0.9 for k in (0, 1, 2))
    assert judged[3]["iou"] < 0.1
    assert judged[4]["iou"] < 0.1
    assert judged[5]["why"]
    row = rows(text)[0]
    assert [row[k] for k in ("matches", "right", "wrong", "undecided")] == ["6", "3", "2", "1"]
    assert float(row["precision"]) == pytest.approx(0.6)
    assert cv2.imread(str(tmp_path / "sheet.png")) is not None


def test_of_a_mosaic_features_are_compared_within_their_cell(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    wide, files = noise(306, 280, 0), (tmp_path / "a.png", tmp_path / "b.png")
    for file, part in zip(files, (wide[:, 6:], wide[:, :-6]), strict=True):  # moves by 6 px
        cv2.imwrite(str(file), part)
    out = tmp_path / "left.tif", tmp_path / "right.tif"
    run("mosaic", *out, *files, "--size", "512x512")  # the fourth cell is the first, turned by half a turn
    square = np.array([[180, 180], [230, 180], [230, 230], [180, 230.0]])
    step = np.array([6, 0])
    rings = [square, 512 - square], [square + step, 512 - square - step]
    sides = [
        ImagePolygons(512, 512, [Polygon(k, ring) for k, ring in enumerate(each)], str(path))
        for each, path in zip(rings, out, strict=True)
    ]
    for partners, right in (([0, 1], 2), ([1, 0], 0)):
        saved(tmp_path / "result", sides, partners, PointMatches.empty(), Failed("a mosaic has none"))
        row = rows(run("precision", tmp_path / "result"))[0]
        assert [row[k] for k in ("right", "wrong", "undecided")] == [str(right), str(2 - right), "0"]


def test_searches_are_compared_on_the_same_polygons(result: Path) -> None:
    found = rows(run("bpm", result, "--repeat", "1"))
    assert [row["search"] for row in found] == ["full", "L = 2", "fixed range"]
    assert all(float(row["recall"]) == 1 and float(row["precision"]) == 1 for row in found)
    assert all(float(row["ACR"]) == pytest.approx(1) for row in found)
    assert int(found[2]["candidates"]) >= int(found[0]["candidates"]) >= 5


def test_mosaic_has_the_asked_size_and_whole_blocks(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    files = []
    for k in range(4):
        files.append(tmp_path / f"{k}.png")
        cv2.imwrite(str(files[-1]), noise(300, 280, k))
    out = tmp_path / "left.tif", tmp_path / "right.tif"
    run("mosaic", *out, *files, "--size", "700x500", "--crs", "EPSG:32633", "--gsd", "0.5")
    middle = [noise(300, 280, k)[12:268, 22:278] for k in range(4)]
    for side, file in enumerate(out):
        with rasterio.open(file) as mosaic:
            assert (mosaic.width, mosaic.height, mosaic.block_shapes[0]) == (700, 500, (256, 256))
            assert mosaic.crs.to_epsg() == 32633
            assert mosaic.res == (0.5, 0.5)
            pixels = mosaic.read().transpose(1, 2, 0).astype(float)
        first, second = middle[side].astype(float), middle[2 + side].astype(float)
        parts = [
            (pixels[:256, :256], first),
            (pixels[:256, 256:512], second),
            (pixels[:256, 512:], first[:, ::-1][:, :188]),  # the second time around, and cut off
            (pixels[256:, :256], second[:, ::-1][:244]),
            (pixels[256:, 256:512], first[::-1][:244]),
        ]
        assert all(np.abs(part - whole).mean() < 3 for part, whole in parts)


def test_growth_is_fitted_over_both_photographs(tmp_path: Path) -> None:
    for n, side in enumerate((10.0, 20.0, 80.0)):
        (tmp_path / str(n)).mkdir()
        values = {"megapixels": [side, side], "wall": 3 * (2 * side) ** 1.1, "peak_mb": 2000, "matches": 7}
        (tmp_path / str(n) / "run.json").write_text(json.dumps(values))
    words = [sys.executable, SCRIPT, "growth", *(tmp_path / name for name in "201")]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    text = done.stdout
    assert [float(row["megapixels"]) for row in rows(text)] == [20, 40, 160]
    assert "to the power of 1.10" in text
