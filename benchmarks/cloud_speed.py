"""Rays and walks a second on meshes of growing size.

    python benchmarks/cloud_speed.py [--faces 100000 1000000 5000000]

A rolling terrain seen from above. Rays are cast through 300,000 places of the view; 2,000 walks join places some 150 px
apart in a view of 4000 px, as the sides of polygons do; 1,000 polygons of some 100 px are lifted, and cut out of the
mesh. Seconds to read neighbours, to build the tree, rays and crossings a second, seconds for the polygons. Prints JSON
(schema zpm2-bench-cloud/1).
"""

import argparse
import time
from typing import Any

import document
import numpy as np

from zpm2.cloud import Cutter, Lifted, SurfaceMesh, SurfacePatch, SurfaceView, lift, open_caster, trace_paths
from zpm2.config import CloudConfig
from zpm2.model import Camera, Polygon, PosedCamera

RAYS, PATHS, EYE = 300_000, 2_000, np.array([0.0, 0.0, 3.0])
DOWN = np.diag([1.0, -1.0, -1.0])
CAMERA = Camera(np.array([[6000.0, 0, 2000], [0, 6000, 2000], [0, 0, 1]]), (4000, 4000))
OVERHEAD = PosedCamera(CAMERA, DOWN, -DOWN @ EYE)


def terrain(faces: int) -> tuple[Any, Any]:
    n = int(np.sqrt(faces / 2))
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    z = 0.05 * np.sin(7 * x) * np.cos(9 * y) + 0.01 * np.sin(61 * x + 3) * np.sin(53 * y)
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    return np.c_[x.ravel(), y.ravel(), z.ravel()], np.r_[np.c_[a, b, c], np.c_[a, c, d]]


def polygons(rng: np.random.Generator, count: int = 1000) -> list[Polygon]:
    """Irregular polygons of 12 corners."""
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    found = []
    for k in range(count):
        radius = rng.uniform(30, 70) * rng.uniform(0.7, 1.3, 12)
        found.append(Polygon(k, rng.uniform(300, 3700, 2) + radius[:, None] * np.c_[np.cos(angle), np.sin(angle)]))
    return found


def measured(faces: int) -> dict[str, Any]:
    mesh, rng = terrain(faces), np.random.default_rng(0)
    start = time.perf_counter()
    surface = SurfaceMesh.of(*mesh)
    read = time.perf_counter() - start
    start = time.perf_counter()
    caster = open_caster(surface)
    caster.first_hits(EYE[None], np.array([[0.0, 0, -1]]))
    built = time.perf_counter() - start
    place = np.c_[rng.uniform(-0.9, 0.9, (RAYS, 2)), np.zeros(RAYS)]
    start = time.perf_counter()
    hits = caster.first_hits(np.broadcast_to(EYE, place.shape), place - EYE)
    cast = time.perf_counter() - start
    first = place[:PATHS]
    angle = rng.uniform(0, 2 * np.pi, PATHS)
    second = np.clip(first + 0.075 * np.c_[np.cos(angle), np.sin(angle), 0 * angle], -0.9, 0.9)
    one, other = (caster.first_hits(np.broadcast_to(EYE, p.shape), p - EYE) for p in (first, second))
    start = time.perf_counter()
    begin, target = (one.face, one.point), (other.face, other.point)
    paths = trace_paths(surface, begin, target, np.broadcast_to(EYE, first.shape), CloudConfig())
    traced = time.perf_counter() - start
    start = time.perf_counter()
    lifts = lift(polygons(rng), SurfaceView(OVERHEAD, surface, caster), CloudConfig())
    lifted = [found for found in lifts if isinstance(found, Lifted)]
    took = time.perf_counter() - start
    start = time.perf_counter()
    cutter = Cutter(surface, OVERHEAD)
    patches = [cutter.cut(found) for found in lifted]
    cut = time.perf_counter() - start
    segments = sum(len(ring.points) for found in lifted for ring in found.rings)
    return {
        "polygons_s": round(took, 2),
        "cut_s": round(cut, 2),
        "patches": sum(isinstance(patch, SurfacePatch) for patch in patches),
        "polygons_lifted": len(lifted) / len(lifts),
        "segments_on_surface": round(1 - sum(found.bridged for found in lifted) / segments, 5),
        "faces": len(surface.faces),
        "surface_s": round(read, 3),
        "tree_s": round(built, 3),
        "hit": float(hits.found.mean()),
        "rays_per_s": round(RAYS / cast),
        "arrived": float(paths.arrived.mean()),
        "crossings": len(paths.points),
        "crossings_per_s": round(len(paths.points) / traced),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, nargs="+", default=[100_000, 500_000, 1_000_000, 5_000_000])
    rows = [measured(faces) for faces in parser.parse_args().faces]
    print(document.text("zpm2-bench-cloud/1", rows=rows))


if __name__ == "__main__":
    main()
