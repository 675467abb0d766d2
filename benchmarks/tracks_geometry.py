"""How well tracks agree with known cameras: the same region must lie on the same epipolar lines in all its photographs.

    python benchmarks/tracks_geometry.py --workspace fountain-P11 --tracks OUT > tracks_geometry.json

`OUT` is what `zpm2 tracks` wrote of the workspace's photographs, at full size or reduced; both are paired by the names
of their files without the ending. Of each two photographs of a track, the epipolar lines that touch the region in
the one (the extent of its outline across the lines) are compared with those that touch it in the other: IoU of the two
intervals, in px of the second photograph, and the worse of both directions. Two regions that only lie anywhere in the
pair rarely have 0.5. A region that something hides in part, or that a border cuts, may have less although it is right.
Prints one JSON document (schema zpm2-bench-tracks/1): tracks by length, and the share of pairs that agree, in all, by
how the regions came into their tracks, and of chance: the same regions, each with one of another track of its
photograph.
"""

import argparse
import itertools
import json
from pathlib import Path
from typing import Any

import document
import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.cloud.workspace import read_views
from zpm2.model import PosedCamera

Array = NDArray[np.float64]
AGREE = 0.5  # IoU of the intervals


def fundamental(left: PosedCamera, right: PosedCamera, scales: tuple[float, float]) -> Array:
    """(3, 3) F of two photographs, each reduced by its scale."""
    turn = right.rotation @ left.rotation.T
    shift = right.translation - turn @ left.translation
    inverse = [
        np.linalg.inv(np.diag([scale, scale, 1]) @ each.camera.matrix)
        for each, scale in zip((left, right), scales, strict=True)
    ]
    return np.asarray(inverse[1].T @ geometry.cross_matrix(shift) @ turn @ inverse[0])


def interval_overlap(matrix: Array, left: Array, right: Array) -> float:
    """IoU of the intervals that two outlines (n, 2) and (m, 2) fill across the epipolar lines, where they cross a line
    through the right outline's centre."""
    lines = geometry.epipolar_lines(matrix, left)
    middle = right.mean(0)
    through = geometry.epipolar_lines(matrix, left.mean(0)[None])[0]
    across = through[:2] / np.linalg.norm(through[:2])
    here = -(lines @ np.append(middle, 1)) / (lines[:, :2] @ across)
    epipole = np.linalg.svd(matrix.T)[2][-1]
    own = np.cross(epipole, geometry.homogeneous(right))  # lines through the epipole and the right vertices
    there = -(own @ np.append(middle, 1)) / (own[:, :2] @ across)
    low, high = max(here.min(), there.min()), min(here.max(), there.max())
    both = max(here.max(), there.max()) - min(here.min(), there.min())
    return float(max(high - low, 0) / both)


def share(values: list[float]) -> dict[str, float | int]:
    """How many pairs there are, the share that agrees, and the median."""
    found = np.array(values)
    agree = float((found >= AGREE).mean()) if len(found) else 0.0
    return {"pairs": len(found), "agree": round(agree, 4), "median": round(float(np.median(found)), 3) if values else 0}


def compared(tracks: dict[str, Any], views: dict[str, PosedCamera]) -> dict[str, Any]:
    """The numbers of one run."""
    widths = {each["name"]: each["width"] for each in tracks["photographs"]}
    scale = {name: widths[name] / views[Path(name).stem].camera.size[0] for name in widths}
    rng = np.random.default_rng(0)
    by_photograph: dict[str, list[Array]] = {name: [] for name in widths}
    for track in tracks["tracks"]:
        for seen in track["seen"]:
            by_photograph[seen["photograph"]].append(np.array(seen["vertices"]))

    def overlap(a: str, b: str, left: Array, right: Array) -> float:
        matrix = fundamental(views[Path(a).stem], views[Path(b).stem], (scale[a], scale[b]))
        return min(interval_overlap(matrix, left, right), interval_overlap(matrix.T, right, left))

    values: dict[str, list[float]] = {"matched": [], "carried": [], "neighbours": [], "farther": [], "chance": []}
    direct = {tuple(sorted((pair["left"], pair["right"]))) for pair in tracks["pairs"]}
    for track in tracks["tracks"]:
        for a, b in itertools.combinations(track["seen"], 2):
            names, rings = (a["photograph"], b["photograph"]), (np.array(a["vertices"]), np.array(b["vertices"]))
            value = overlap(*names, *rings)
            values["carried" if "carried" in (a["how"], b["how"]) else "matched"].append(value)
            values["neighbours" if tuple(sorted(names)) in direct else "farther"].append(value)
            others = by_photograph[names[1]]
            values["chance"].append(overlap(*names, rings[0], others[rng.integers(len(others))]))
    lengths = np.bincount([len(track["seen"]) for track in tracks["tracks"]]).tolist()
    return {
        "tracks": len(tracks["tracks"]),
        "by_photographs": {str(n): count for n, count in enumerate(lengths) if count},
        "three_or_more": sum(lengths[3:]),
        "closed": sum(track["closed"] for track in tracks["tracks"]),
        "contradicted": sum(pair["contradicted"] for pair in tracks["pairs"]),
        "matches": sum(pair["matches"] for pair in tracks["pairs"]),
        "events": len(tracks["events"]),
        "all": share(values["matched"] + values["carried"]),
        **{name: share(each) for name, each in values.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--workspace", type=Path, required=True)
    parser.add_argument("--tracks", type=Path, required=True, nargs="+")
    options = parser.parse_args()
    views = {Path(view.name).stem: view.camera for view in read_views(options.workspace)}
    found = [
        {"run": each.name, **compared(json.loads((each / "tracks.json").read_text()), views)} for each in options.tracks
    ]
    print(document.text("zpm2-bench-tracks/1", rows=found))


if __name__ == "__main__":
    main()
