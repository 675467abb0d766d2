"""Polygon clouds of rectified pairs with known disparity: how much is lifted, and how well.

    python benchmarks/cloud_stereo.py --root DATA --predictions OUT [--pairs NAME ...]

DATA/pairs.json lists the pairs (those with a disparity are taken), OUT is the folder of `zpm2 eval pairs --root DATA`,
of which the matches are taken. The surface comes from semi-global matching, cameras are a pinhole as wide as the image
and a baseline of 1 (errors in px of disparity do not depend on them). For each pair, with one scale for each polygon
(the paper's diffusion) and with its part on one surface: accepted share of the matches, patches, share of the seen
surface that they cover, median and share above 1 px of |disparity of the patches - truth|, left-right distance of the
boundaries (median, of the size), seconds. "naive": share of left polygons whose own outline leaves the surface or jumps
(which corners projected one by one would span). Prints the table to stderr and JSON (schema zpm2-bench-cloud-stereo/1).
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import document
import numpy as np

from zpm2.cloud import MatchedPair, PolygonCloud, PosedPhotograph, SurfaceView, build, fill_holes, open_caster
from zpm2.cloud.constraints import violations
from zpm2.cloud.disparity_mesh import disparity_mesh
from zpm2.config import CloudConfig, StereoConfig
from zpm2.errors import Failed
from zpm2.evaluate.datasets.pair_list import from_json
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.formats.maps import read_disparity
from zpm2.model import Camera
from zpm2.photos.images import read_image
from zpm2.result import MatchResult
from zpm2.stereo.dense import disparity_range, semi_global
from zpm2.stereo.rig import Rig, rig_of

MODES = ("scale", "surface")
COLUMNS = ("pair", "diffusion", "matches", "accepted", "patches", "coverage", "px", "above_1", "distance", "naive", "s")


def errors(cloud: PolygonCloud, rig: Rig, truth: Any) -> Any:
    """px, at the middles of the patches' triangles that the truth knows."""
    found = [np.zeros(0)]
    for polygon in cloud.patches:
        points = cloud.world(polygon.patch.vertices[polygon.patch.faces].mean(1))
        at = rig.left.pixels(points[:, :2] / points[:, 2:]).astype(int)
        inside = (at >= 0).all(1) & (at < rig.left.size).all(1)
        disparity = rig.left.matrix[0, 0] * rig.baseline / points[inside, 2] - rig.offset
        found.append(np.abs(disparity - truth[at[inside, 1], at[inside, 0]]))
    every = np.concatenate(found)
    return every[np.isfinite(every)]


def measured(pair: EvalPair, predictions: Path) -> list[dict[str, Any]]:
    assert isinstance(pair.truth, DisparityTruth)
    result = MatchResult.load(predictions / "predictions" / pair.name)
    left, right = read_image(pair.left), read_image(pair.right)
    size = left.width, left.height
    camera = Camera(np.array([[size[0], 0, size[0] / 2], [0, size[0], size[1] / 2], [0, 0, 1.0]]), size)
    bounds = disparity_range(result.points.left[:, 0] - result.points.right[:, 0], left.width, StereoConfig())
    if isinstance(bounds, Failed):
        return [{"pair": pair.name, "failed": str(bounds)}]
    offset = max(0, 2 - bounds[0])  # so that all of the search lies before the cameras
    rig = rig_of(camera, Camera(camera.matrix + offset * np.eye(3, k=2), size), 1.0)
    start = time.perf_counter()
    surface = disparity_mesh(semi_global(left, right, *bounds, StereoConfig()), rig, CloudConfig())
    surface = fill_holes(surface, CloudConfig())
    caster = open_caster(surface)
    made = time.perf_counter() - start
    truth = read_disparity(pair.truth.file, size, pair.truth.scale, pair.truth.sign)
    views = [PosedPhotograph(side, Path(side), view) for side, view in zip(("left", "right"), rig.views, strict=True)]
    outlines = [polygon.shape for polygon in result.matched_polygons()[0]]
    on_mesh = SurfaceView(rig.views[0], surface, caster)
    naive = [found is not None for found in violations(outlines, on_mesh, CloudConfig())]
    rows = []
    for mode in MODES:
        start = time.perf_counter()
        cloud = build(views, [MatchedPair(0, 1, result)], surface, caster, CloudConfig(diffusion=mode))
        seconds = time.perf_counter() - start
        error = errors(cloud, rig, truth)
        supports = [
            (s.distance / p.patch.area**0.5) for p in cloud.patches for s in p.supports if s.distance is not None
        ]
        rows.append(
            {
                "pair": pair.name,
                "diffusion": mode,
                "matches": cloud.matches,
                "accepted": round(cloud.accepted / max(cloud.matches, 1), 3),
                "patches": len(cloud.patches),
                "coverage": round(cloud.coverage, 3),
                "px": round(float(np.median(error)), 3) if len(error) else None,
                "above_1": round(float((error > 1).mean()), 3) if len(error) else None,
                "distance": round(float(np.median(supports)), 4) if supports else None,
                "naive": round(float(np.mean(naive)), 3) if naive else None,
                "s": round(seconds, 2),
                "s_surface": round(made, 2),
                "triangles": len(surface.faces),
                "reasons": cloud.reasons(),
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--predictions", type=Path, required=True)
    parser.add_argument("--pairs", nargs="*")
    options = parser.parse_args()
    rows = []
    print("| " + " | ".join(COLUMNS) + " |", file=sys.stderr)
    for pair in from_json(options.root, None):
        if not isinstance(pair.truth, DisparityTruth) or (options.pairs and pair.name not in options.pairs):
            continue
        for row in measured(pair, options.predictions):
            rows.append(row)
            print("| " + " | ".join(str(row.get(name, "")) for name in COLUMNS) + " |", file=sys.stderr, flush=True)
    for mode in MODES:
        of = [row for row in rows if row.get("diffusion") == mode]
        means = {
            name: round(float(np.mean([row[name] for row in of if row[name] is not None])), 3) for name in COLUMNS[3:]
        }
        print(
            "| mean | " + mode + " | | " + " | ".join(str(means[name]) for name in COLUMNS[3:]) + " |", file=sys.stderr
        )
    print(document.text("zpm2-bench-cloud-stereo/1", rows=rows))


if __name__ == "__main__":
    main()
