"""How the matcher alone (global and local stage, polygons and points given) grows with the number of polygons.

    python benchmarks/matcher_growth.py > matcher_growth.json

Synthetic pairs: star-shaped polygons tile a textured plane whose right view is shifted, tilted and noisy; the image
grows with their number, so that density stays. Each size is timed `--repeat` times and the best counts. The targets:
at most 0.3 s for 50 x 50 polygons, and 2000 x 2000 within 20 times of 200 x 200. The code is the numpy path, which is
the same on every device.
"""

import argparse
from dataclasses import dataclass
from time import perf_counter

import cv2
import document
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import Config, preset
from zpm2.global_match import initial_geometry, locate, search_candidates
from zpm2.local_match import MatchProblem, match_polygons
from zpm2.model import Image, PointMatches, Polygon, PolygonArrays

SCHEMA = "zpm2-bench-growth/1"
GRIDS = {50: (10, 5), 200: (20, 10), 2000: (50, 40)}  # polygons: columns, rows
CELL = 96  # px
VERTICES = 24
POINTS = 20  # per polygon, one in ten wrong
TARGETS = {"seconds_50": 0.3, "ratio_2000_to_200": 20.0}


@dataclass(frozen=True)
class Pair:
    """One synthetic pair: everything that the matcher is given. Left polygon k is right polygon `truth[k]`."""

    images: tuple[Image, Image]
    polygons: tuple[list[Polygon], list[Polygon]]
    points: PointMatches
    truth: NDArray[np.int64]


def synthetic_pair(columns: int, rows: int, seed: int = 0) -> Pair:
    """`columns` x `rows` polygons, one in each cell of CELL px."""
    rng = np.random.default_rng(seed)
    width, height = columns * CELL, rows * CELL
    tilt = np.array([[1, 0.01, -0.15 * CELL], [0.005, 1, 3], [0, 0, 1]])
    texture = cv2.GaussianBlur(rng.normal(0, 1, (height, width)).astype(np.float32), (0, 0), 1.5)
    texture = 128 + 40 * texture / texture.std()
    to_centers = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # OpenCV puts pixel centres at 0
    moved = cv2.warpPerspective(
        texture, to_centers @ tilt @ np.linalg.inv(to_centers), (width, height), borderMode=cv2.BORDER_REFLECT
    )
    grays = (texture + rng.normal(0, 3, texture.shape), 0.8 * moved + 30 + rng.normal(0, 3, texture.shape))
    images = [Image(np.repeat(np.clip(g, 0, 255).astype(np.uint8)[..., None], 3, axis=2)) for g in grays]
    centers = CELL * (np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) + 0.5)
    n = len(centers)
    angle = np.linspace(0, 2 * np.pi, VERTICES, endpoint=False)
    radius = CELL * rng.uniform(0.3, 0.6, (n, VERTICES))
    rings = centers[:, None] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    others = geometry.project(tilt, rings.reshape(-1, 2)).reshape(rings.shape) + rng.normal(0, 0.7, rings.shape)
    truth = rng.permutation(n)
    left = [Polygon(k, ring) for k, ring in enumerate(rings)]
    right = [Polygon(k, others[row]) for k, row in enumerate(np.argsort(truth))]
    at = np.repeat(centers, POINTS, axis=0) + rng.uniform(-CELL / 2, CELL / 2, (n * POINTS, 2))
    to = geometry.project(tilt, at) + rng.normal(0, 0.5, at.shape)
    wrong = rng.random(len(at)) < 0.1
    to[wrong] = rng.uniform((0, 0), (width, height), (int(wrong.sum()), 2))
    return Pair((images[0], images[1]), (left, right), PointMatches(at, to, np.ones(len(at))), truth)


def run(pair: Pair, config: Config) -> dict[str, float]:
    """Both stages once: their seconds, and how many of the polygons were matched and matched rightly."""
    for image in pair.images:
        for name in ("gray", "levels"):
            image.__dict__.pop(name, None)  # computed again, as in a fresh pair
    polygons = [[Polygon(p.id, p.exterior) for p in side] for side in pair.polygons]
    start = perf_counter()
    arrays = PolygonArrays(polygons[0]), PolygonArrays(polygons[1])
    initial = initial_geometry(pair.points, config.global_match, config.seed)
    locations = locate(*pair.images, arrays[0].centers, initial, config.global_match)
    candidates = search_candidates(*arrays, locations, config.global_match)
    middle = perf_counter()
    problem = MatchProblem(pair.images, arrays, initial, locations, candidates)
    matches = match_polygons(problem, config.local_match)
    end = perf_counter()
    right = sum(pair.truth[m.left] == m.right for m in matches)
    return {
        "seconds": end - start,
        "global_seconds": middle - start,
        "local_seconds": end - middle,
        "candidates": len(candidates),
        "matches": len(matches),
        "right": int(right),
    }


def measure(config: Config, repeat: int) -> dict[str, object]:
    """The report: one entry per size, and whether the targets are met."""
    sizes = []
    for count, (columns, rows) in GRIDS.items():
        pair = synthetic_pair(columns, rows)
        best = min((run(pair, config) for _ in range(repeat)), key=lambda seconds: seconds["seconds"])
        sizes.append({"polygons": count, "width": columns * CELL, "height": rows * CELL, **best})
    seconds = {entry["polygons"]: entry["seconds"] for entry in sizes}
    reached = {"seconds_50": seconds[50], "ratio_2000_to_200": seconds[2000] / seconds[200]}
    return {
        "repeat": repeat,
        "sizes": sizes,
        "reached": reached,
        "targets": TARGETS,
        "met": {name: reached[name] <= limit for name, limit in TARGETS.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    print(document.text(SCHEMA, **measure(preset(arguments.preset), arguments.repeat)))


if __name__ == "__main__":
    main()
