"""Given polygons, 50,000 on each side of an 80-megapixel pair: time by stage, peak memory, share of right matches.

    python benchmarks/many_polygons.py --polygons 5000 20000 50000 > many_polygons.json

Synthetic: star-shaped polygons in the cells of a grid, a texture that is different everywhere, the right photograph
tilted and enlarged; one polygon in ten has no partner, on either side. The photographs are GeoTIFFs in a temporary
folder, the polygons GeoJSON; points are SIFT's. Each size runs in a process of its own. `search` compares the
bidirectional pyramid with a fixed range (paper, Efficiency of BPM) on the same polygons and points, without the
candidates that carried shapes bring: seconds of matching in blocks, best of two in turns, matches, share of right ones.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import cv2
import document
import numpy as np
import rasterio
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.api import Matcher
from zpm2.config import Config, assign, preset
from zpm2.formats import geojson
from zpm2.model import Polygon, PolygonArrays
from zpm2.photos.source import opened
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.tiled.blocks import LargePair, match_blocks
from zpm2.tiled.cells import cells, warped_by_cells

CELL = 40  # px
BLOCK = 1024  # px, of the files
VERTICES = 16
MISSING = 0.1
MAP = np.array([[1.04, 0.03, -60.0], [-0.025, 1.03, 210.0], [4e-7, -3e-7, 1.0]])  # left to right px


def texture(x: NDArray[np.float32], y: NDArray[np.float32], tables: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Smooth noise at (h, w) places: octaves whose periods have no common multiple in sight."""
    value = np.zeros(x.shape, np.float32)
    for table, step in zip(tables, (2.3, 5.1, 17.9, 61.7), strict=True):
        at = [np.mod(c / step, len(table) - 1).astype(np.float32) for c in (x, y)]
        value += cv2.remap(table, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(np.clip(128 + 32 * value, 0, 255), np.uint8)


def write_photograph(path: Path, width: int, height: int, to_left: NDArray[np.float64] | None) -> None:
    """The texture, as it is or as `to_left` (3 x 3, px to left px) shows it, block by block."""
    tables = np.random.default_rng(1).standard_normal((4, 701, 701)).astype(np.float32)
    profile = {"driver": "GTiff", "dtype": "uint8", "count": 1, "width": width, "height": height}
    with rasterio.open(path, "w", tiled=True, blockxsize=BLOCK, blockysize=BLOCK, **profile) as file:
        for y0 in range(0, height, BLOCK):
            for x0 in range(0, width, BLOCK):
                w, h = min(BLOCK, width - x0), min(BLOCK, height - y0)
                x, y = np.meshgrid(np.arange(x0, x0 + w) + 0.5, np.arange(y0, y0 + h) + 0.5)
                if to_left is not None:
                    x, y = geometry.project(to_left, np.c_[x.ravel(), y.ravel()]).T.reshape(2, h, w)
                window = ((y0, y0 + h), (x0, x0 + w))
                file.write(texture(x.astype(np.float32), y.astype(np.float32), tables), 1, window=window)


def stars(columns: int, rows: int) -> list[NDArray[np.float64]]:
    """(VERTICES, 2) rings, one in each cell."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:rows, :columns].reshape(2, -1, 1)
    angle = np.linspace(0, 2 * np.pi, VERTICES, endpoint=False)
    radius = CELL * rng.uniform(0.25, 0.46, (len(x), VERTICES))
    ring = np.stack([(x + 0.5) * CELL + radius * np.cos(angle), (y + 0.5) * CELL + radius * np.sin(angle)], axis=2)
    return list(ring)


def write_regions(path: Path, rings: list[NDArray[np.float64]], ids: NDArray[np.int64], size: tuple[int, int]) -> None:
    polygons = [Polygon(int(k), rings[k]) for k in ids]
    geojson.write(path, geojson.feature_collection(polygons, None, path.name, *size))


def run(count: int) -> dict[str, object]:
    """One pair with about `count` polygons a side."""
    columns = round((count * 1.5) ** 0.5)
    rows = round(count / columns)
    width, height = columns * CELL, rows * CELL
    corners = geometry.project(MAP, np.array([[0, 0], [width, 0], [width, height], [0, height]], float))
    other = tuple(np.ceil(corners.max(0)).astype(int).tolist())
    rng = np.random.default_rng(3)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_photograph(folder / "left.tif", width, height, None)
        write_photograph(folder / "right.tif", *other, np.linalg.inv(MAP))
        rings = stars(columns, rows)
        moved = [geometry.project(MAP, ring) + rng.normal(0, 0.3, ring.shape) for ring in rings]
        kept = [rng.permutation(len(rings))[: round((1 - MISSING) * len(rings))] for _ in range(2)]
        write_regions(folder / "left.geojson", rings, kept[0], (width, height))
        write_regions(folder / "right.geojson", moved, kept[1], other)
        config = assign(preset("default"), ["tiles.mode=on", "points.methods=sift", "device=cpu"])
        sides = [PrecomputedSegmenter(folder / f"{side}.geojson") for side in ("left", "right")]
        start = perf_counter()
        result = Matcher(config, segmenter=(sides[0], sides[1]))(folder / "left.tif", folder / "right.tif")
        seconds = perf_counter() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        search = compare_searches(result, (folder / "left.tif", folder / "right.tif"), config)
    both = len(np.intersect1d(*kept))
    right = sum(match.left == match.right for match in result.matches)
    return {
        "megapixels": round(width * height / 1e6, 1),
        "left": len(result.left.polygons),
        "right": len(result.right.polygons),
        "seconds": round(seconds, 1),
        "by_stage": {stage: round(value, 1) for stage, value in result.timings.items()},
        "points": len(result.points),
        "matches": len(result.matches),
        "precision": round(right / max(len(result.matches), 1), 4),
        "recall": round(right / both, 4),
        "peak_gb": round(peak, 2),
        "search": search,
    }


def compare_searches(result: MatchResult, photographs: tuple[Path, Path], config: Config) -> dict[str, object]:
    """Matching in blocks by either search, in turns."""
    left, right = PolygonArrays(result.left.polygons), PolygonArrays(result.right.polygons)
    nothing = np.zeros(len(left), bool), np.zeros(len(right), bool)
    found: dict[str, dict[str, float]] = {}
    with opened(*photographs) as sources:
        places = list(cells(left, result.points, config))
        warped = warped_by_cells(left, places, config.local_match)
        for name in ("pyramid", "fixed") * 2:
            of = assign(config, ["guided.direction=off", f"global_match.search={name}"])
            start = perf_counter()
            matches = match_blocks(LargePair(sources, (left, right), nothing), places, warped, of)
            seconds = min(perf_counter() - start, found.get(name, {}).get("seconds", np.inf))
            good = sum(match.left == match.right for match in matches)
            found[name] = {"seconds": seconds, "matches": len(matches), "precision": good / max(len(matches), 1)}
    return {**found, "ratio": found["pyramid"]["seconds"] / found["fixed"]["seconds"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--polygons", type=int, nargs="+", default=[5000, 20000, 50000])
    sizes = parser.parse_args().polygons
    if len(sizes) == 1:
        print(document.text("zpm2-bench-polygons/1", **run(sizes[0])))
        return
    for size in sizes:
        subprocess.run([sys.executable, __file__, "--polygons", str(size)], check=True)


if __name__ == "__main__":
    main()
