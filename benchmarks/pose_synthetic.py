"""Error of the pose against noise and outliers, on synthetic scenes with exact truth.

    python benchmarks/pose_synthetic.py [--draws 20]

500 points at 4 to 12 baselines of depth, focal length 700 px, images of 800 x 600 px, turned by 10 degrees. Medians of
the errors of R and of the direction of t over the draws, degrees, and the share of draws with an error above 5 degrees
or without a pose, for both estimators and what follows them. Prints a Markdown table.
"""

import argparse

import cv2
import numpy as np

from zpm2.config import Config, PoseConfig
from zpm2.errors import Failed
from zpm2.evaluate import pose_error
from zpm2.evaluate.report import table
from zpm2.model import Camera, PointMatches
from zpm2.pose import PoseFinder
from zpm2.pose.points import Correspondences

SIZE = (800, 600)
CAMERA = Camera(np.array([[700.0, 0, 400], [0, 700, 300], [0, 0, 1]]), SIZE)
TRUTH = np.eye(4)
TRUTH[:3, :3], TRUTH[:3, 3] = cv2.Rodrigues(np.radians([2.0, 9.5, -2.0]))[0], (-1.0, 0.1, 0.15)


def draw(seed: int, noise: float, outliers: float, n: int = 500) -> Correspondences:
    """n homologous points, none of them in a region."""
    rng = np.random.default_rng(seed)
    rays = CAMERA.rays(rng.uniform([0, 0], SIZE, (4 * n, 2)))
    world = np.c_[rays, np.ones(len(rays))] * rng.uniform(4, 12, (len(rays), 1))
    there = world @ TRUTH[:3, :3].T + TRUTH[:3, 3]
    left, right = CAMERA.pixels(rays), CAMERA.pixels(there[:, :2] / there[:, 2:])
    seen = np.flatnonzero(((right > 0) & (right < SIZE)).all(1))[:n]
    left, right = (points[seen] + rng.normal(0, noise, (len(seen), 2)) for points in (left, right))
    wrong = rng.random(len(seen)) < outliers
    right[wrong] = rng.uniform([0, 0], SIZE, (int(wrong.sum()), 2))
    points = PointMatches(left, right, np.ones(len(seen)))
    return Correspondences(points, np.full(len(seen), -1), np.zeros(len(seen), bool))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    options = parser.parse_args()
    rows = []
    for noise, outliers in ((0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.5, 0.3), (0.5, 0.6), (0.5, 0.8), (1.0, 0.6)):
        cells: list[object] = [f"{noise} px", f"{100 * outliers:.0f} %"]
        for name in ("opencv", "poselib"):
            finder = PoseFinder(Config(pose=PoseConfig(estimator=name, crops="off", points="all")))  # type: ignore[arg-type]
            errors = []
            for seed in range(options.draws):
                pose, _, _ = finder.estimate(draw(seed, noise, outliers), (CAMERA, CAMERA), seed)
                failed = isinstance(pose, Failed) or pose.translation is None
                errors.append((np.inf, np.inf) if failed else pose_error(pose.rotation, pose.translation, TRUTH))
            middle = np.median(errors, axis=0)
            lost = np.mean(np.max(errors, axis=1) > 5)
            cells += [f"{middle[0]:.3f}", f"{middle[1]:.3f}", f"{100 * lost:.0f} %"]
        rows.append(cells)
    columns = [f"{name} {what}" for name in ("opencv", "poselib") for what in ("R", "t", "lost")]
    print(table(["noise", "outliers", *columns], rows))


if __name__ == "__main__":
    main()
