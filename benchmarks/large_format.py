"""Large photographs: time, memory, precision without ground truth, growth, and the pyramid against a fixed range.

    python benchmarks/large_format.py mosaic LEFT.tif RIGHT.tif --size 11500x7500 A1.jpg A2.jpg B1.jpg B2.jpg ...
    python benchmarks/large_format.py run LEFT.tif RIGHT.tif OUT [--set stage.field=value ...]
    python benchmarks/large_format.py precision OUT [--sheet worst.png]
    python benchmarks/large_format.py growth OUT1 OUT2 ...
    python benchmarks/large_format.py bpm OUT [--repeat 3] [--set stage.field=value ...]

`precision` judges a saved result by SIFT features, which had no part in it (preset `default` takes its points from
XFeat): those in and around a left polygon are looked for in the right photograph, and an affine map of those found,
by RANSAC, says where the polygon should be. A match is right if its right polygon shares at least half with that
(IoU), wrong if not, and undecided where fewer than 8 features around the polygon agree. Of a mosaic, features and
polygons are compared within their cell only: beyond its border the two photographs show different things, and its
photographs come again in other cells. Features in the polygon itself shift the map, where three or more agree: what
stands high moves otherwise than the ground around it.

`bpm` is the paper's table of large-format pairs on one result's polygons: the same matcher with the full pyramid, two
levels of it, and a fixed range. The truth are the pairs of polygons that are each other's best by SIFT with an IoU of
at least 0.5; ACR is the area of the matched left polygons over that of the true ones, both of decided polygons.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from time import perf_counter
from typing import Any
from unittest import mock

import cv2
import document
import mosaic
import numpy as np
import PIL.Image
import shapely
from numpy.typing import NDArray

from zpm2 import MatchResult, config
from zpm2.api import Matcher
from zpm2.config import Config
from zpm2.evaluate.report import table
from zpm2.model import Polygon, PolygonArrays
from zpm2.photos.source import Source, opened
from zpm2.polygons.repair import repaired
from zpm2.tiled import blocks
from zpm2.tiled.cells import cells, warped_by_cells
from zpm2.view.contact import Crop, contact_sheet, crop_window

Array = NDArray[np.float64]
TILE, RIM = (
    1024,
    32,
)  # px of a reduced photograph: side of a tile that is searched for features, and what is seen around
CONTRAST = 0.005  # aerial photographs have little
RATIO = 0.8  # of the nearest to the second nearest descriptor
TURN = np.pi / 4  # by which features of a pair may be turned otherwise than most
COARSE = 2000  # px, longer side of the photographs in which places are looked for first
WINDOW = 900  # reduced px, longer side of the window around a left polygon
MARGIN = 96  # px around a polygon, at least
NEAR = 24  # reduced px around a polygon's box, at least, whose features speak for it
MOST = 800  # features of a left window, those nearest to the polygon
NOISE = 3.0  # reduced px
NEIGHBORS, COARSE_NOISE = 40, 8.0  # features around a place that is looked for first, reduced px
INLIERS = 8
MOST_STRETCH = 4.0  # of the two axes of an affine map
SEEN = 0.25  # share of a polygon that must lie in the right photograph
NOTHING = np.zeros((0, 128), np.float32)
SQUARE, STRONGEST = 128, 40  # reduced px, and features of it by which places are looked for first
SAME = 0.5  # IoU


# --- evidence


@dataclass(frozen=True, eq=False)
class Features:
    """n SIFT features."""

    points: Array  # (n, 2) px of the photograph
    angle: NDArray[np.float32]  # (n,) radians
    response: NDArray[np.float32]  # (n,) contrast
    descriptors: NDArray[np.float32]  # (n, 128) of unit length

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: NDArray[Any]) -> "Features":
        return Features(self.points[rows], self.angle[rows], self.response[rows], self.descriptors[rows])

    @staticmethod
    def join(parts: Sequence["Features"]) -> "Features":
        """All of them."""
        none = Features(np.zeros((0, 2)), np.zeros(0, np.float32), np.zeros(0, np.float32), NOTHING)
        return Features(*(np.concatenate([getattr(p, f.name) for p in (none, *parts)]) for f in fields(Features)))

    def strongest(self, side: float, most: int) -> "Features":
        """At most so many in each square of `side` px."""
        _, square = np.unique(self.points // side, axis=0, return_inverse=True)
        order = np.lexsort((-self.response, square.ravel()))
        count = np.bincount(square.ravel())
        rank = np.arange(len(self)) - np.repeat(np.cumsum(count) - count, count)
        return self[np.sort(order[rank < most])]


@dataclass(eq=False)
class Photograph:
    """The features of a photograph reduced by powers of two, tile by tile, as they are asked for."""

    source: Source
    tiles: dict[tuple[int, int, int], Features] = field(default_factory=dict)

    def features(self, low: Array, high: Array, reduction: int) -> Features:
        """Those between two corners, px."""
        size = np.array([self.source.width, self.source.height])
        low, high = np.clip(low, 0, size), np.clip(high, 0, size)
        first, last = (low // (TILE * reduction)).astype(int), np.ceil(high / (TILE * reduction)).astype(int)
        names = [(reduction, x, y) for y in range(first[1], last[1]) for x in range(first[0], last[0])]
        found = [self.tiles[name] if name in self.tiles else self._tile(*name) for name in names]
        return Features.join([each[((each.points >= low) & (each.points < high)).all(1)] for each in found])

    def _tile(self, reduction: int, x: int, y: int) -> Features:
        size = np.array([self.source.width, self.source.height])
        own = np.array([[x, y], [x + 1, y + 1]]) * TILE * reduction
        low, high = np.maximum(own[0] - RIM * reduction, 0), np.minimum(own[1] + RIM * reduction, size)
        reduced = np.maximum((high - low) // reduction, 1)
        image = self.source.read((*low.tolist(), *high.tolist()), tuple(reduced.tolist()))
        sift = cv2.SIFT.create(contrastThreshold=CONTRAST, enable_precise_upscale=True)
        points, raw = sift.detectAndCompute(np.rint(image.gray).astype(np.uint8), None)
        raw = NOTHING if raw is None else raw
        at = (np.array([p.pt for p in points], np.float64).reshape(-1, 2) + 0.5) * (high - low) / reduced + low
        inside = ((at >= own[0]) & (at < own[1])).all(1)
        descriptors = np.sqrt(raw / np.maximum(raw.sum(1, keepdims=True), 1e-12))
        angle, response = (np.array([getattr(p, name) for p in points], np.float32) for name in ("angle", "response"))
        self.tiles[reduction, x, y] = Features(at, np.deg2rad(angle), response, descriptors)[inside]
        return self.tiles[reduction, x, y]


def pairs_of(left: Features, right: Features, turn: float | None = None) -> NDArray[np.int64]:
    """(k, 2) rows of features that are each other's nearest and pass the ratio test; of those that are turned by about
    `turn`, where it is given: what is turned otherwise is no rival then."""
    if len(left) == 0 or len(right) < 2:
        return np.zeros((0, 2), np.int64)
    near, best = np.zeros(len(left), np.int64), np.zeros(len(left), bool)
    back, least = np.zeros(len(right), np.int64), np.full(len(right), np.inf, np.float32)
    for start in range(0, len(left), 1024):
        part = left[np.arange(start, min(start + 1024, len(left)))]
        squared = 2 - 2 * (part.descriptors @ right.descriptors.T)
        if turn is not None:
            off = right.angle - part.angle[:, None] - np.float32(turn)
            squared[np.cos(off) < np.cos(TURN)] = 4
        mine = squared.argmin(1)
        near[start : start + len(part)] = mine
        row = squared.argmin(0)
        lower = squared[row, np.arange(len(right))]
        back = np.where(lower < least, start + row, back)
        least = np.minimum(lower, least)
        first = squared[np.arange(len(part)), mine]
        squared[np.arange(len(part)), mine] = 4
        best[start : start + len(part)] = (first < RATIO**2 * squared.min(1)) & (first < 2)
    rows = np.flatnonzero(best & (back[near] == np.arange(len(left))))
    return np.c_[rows, near[rows]]


@dataclass(frozen=True, eq=False)
class CandidateScores:
    """Where SIFT puts a left polygon."""

    shape: Any  # shapely polygon, right px; None where undecided
    extent: Any  # what the right photograph may show of it, and the left one of its partner
    inliers: int
    why: str = ""  # undecided

    def iou(self, shape: Any) -> float:
        """Of the polygon as it should be with another one of the right photograph, where both photographs look."""
        here, there = (shapely.intersection(each, self.extent) for each in (self.shape, shape))
        union = shapely.area(shapely.union(here, there))
        return float(shapely.area(shapely.intersection(here, there)) / union) if union > 0 else 0.0


class Check:
    """Both photographs of a result, and what their SIFT features say about polygons."""

    def __init__(self, sources: tuple[Source, Source]) -> None:
        self.sources = sources
        self.left, self.right = Photograph(sources[0]), Photograph(sources[1])
        self.cells = [None if s.path is None else mosaic.cell_of(s.path) for s in sources]
        boxes = self._boxes()
        self.reduction = _power(max(float((high - low).max()) for low, high in boxes) / COARSE)
        found = [self._alike(low, high) for low, high in boxes]
        self.coarse = tuple(np.concatenate([pair[k] for pair in found]) for k in range(2))

    def _boxes(self) -> list[tuple[Array, Array]]:
        """Corners of what is compared as a whole: the photographs, or each cell of mosaics, which repeat themselves."""
        size = np.array([(s.width, s.height) for s in self.sources]).max(0)
        if self.cells[0] is None:
            return [(np.zeros(2), size)]
        cell = np.array(self.cells[0])
        corners = itertools.product(range(0, size[0], cell[0]), range(0, size[1], cell[1]))
        return [(np.array(low), np.minimum(low + cell, size)) for low in corners]

    def _alike(self, low: Array, high: Array) -> tuple[Array, Array]:
        """(k, 2) left and right px of coarse features that match, in the turn that most of them have."""
        every = [
            photograph.features(low, high, self.reduction).strongest(SQUARE * self.reduction, STRONGEST)
            for photograph in (self.left, self.right)
        ]
        rows = pairs_of(every[0], every[1])
        turns = every[1].angle[rows[:, 1]] - every[0].angle[rows[:, 0]]
        count, edges = np.histogram(np.mod(turns + np.pi / 36, 2 * np.pi), 36, (0, 2 * np.pi))
        rows = pairs_of(every[0], every[1], float(edges[count.argmax()]))
        return every[0].points[rows[:, 0]], every[1].points[rows[:, 1]]

    def evidence(self, polygon: Polygon) -> CandidateScores:
        """For one left polygon."""
        guess = self._coarse(polygon.center)
        if guess is None:
            return CandidateScores(None, None, 0, "place not found")
        low, high = np.array(polygon.bounds[:2]), np.array(polygon.bounds[2:])
        side = float((high - low).max())
        rim = max(MARGIN, side)
        reduction = _power((side + 2 * rim) / WINDOW)
        seen = [self._seen(k, polygon.center) for k in range(2)]
        left = self.left.features(*_within(seen[0], low - rim, high + rim), reduction)
        if len(left) > MOST:
            left = left[np.argsort(_away(left.points, low, high), kind="stable")[:MOST]]
        corners = _mapped(guess, np.array(shapely.box(*(low - rim), *(high + rim)).exterior.coords))
        around = _within(seen[1], corners.min(0) - rim, corners.max(0) + rim)
        right = self.right.features(*around, reduction)
        rows = pairs_of(left, right)
        here, there = left.points[rows[:, 0]], right.points[rows[:, 1]]
        matrix, inliers = _affine(here, there, low, high, reduction)
        if matrix is None:
            return CandidateScores(None, None, inliers, "too few features agree")
        matrix = _shifted(matrix, here, there, polygon.shape.buffer(0.03 * side), reduction)
        shape = repaired(_moved(matrix, polygon.shape))
        extent = _moved(matrix, seen[0]).intersection(seen[1])
        if extent.intersection(shape).area < SEEN * shape.area:
            return CandidateScores(None, None, inliers, "out of sight")
        return CandidateScores(shape, extent, inliers)

    def _coarse(self, point: Array) -> Array | None:
        """(2, 3) similarity of the coarse features nearest to a point."""
        low, high = np.array(self._seen(0, point).bounds).reshape(2, 2)
        same = ((self.coarse[0] >= low) & (self.coarse[0] < high)).all(1)
        here, there = self.coarse[0][same], self.coarse[1][same]
        if len(here) < INLIERS:
            return None
        near = np.argsort(((here - point) ** 2).sum(1), kind="stable")[:NEIGHBORS]
        cv2.setRNGSeed(0)
        matrix, agree = cv2.estimateAffinePartial2D(
            here[near], there[near], method=cv2.RANSAC, ransacReprojThreshold=COARSE_NOISE * self.reduction
        )
        return None if matrix is None or agree.sum() < INLIERS else matrix

    def _seen(self, k: int, point: Array) -> Any:
        """The photograph as a shapely box; of a mosaic, which shows the same in each cell of both photographs, the cell
        that a point lies in."""
        size, cell = np.array([self.sources[k].width, self.sources[k].height]), self.cells[k]
        if cell is None:
            return shapely.box(0, 0, *size)
        low = np.clip(point // cell, 0, (size - 1) // cell) * cell
        return shapely.box(*low, *np.minimum(low + cell, size))


def _affine(here: Array, there: Array, low: Array, high: Array, reduction: int) -> tuple[Array | None, int]:
    """(2, 3) affine map of what lies at a polygon's box, and how many features there agree: of those in the box alone
    where they suffice, else of those around it too."""
    inliers, side = 0, float((high - low).max())
    about = max(0.5 * side, NEAR * reduction)
    away = _away(here, low, high)
    for rim in (0.0, about, np.inf):
        rows = away <= rim
        if rows.sum() < INLIERS:
            continue
        cv2.setRNGSeed(0)
        matrix, agree = cv2.estimateAffine2D(
            here[rows], there[rows], method=cv2.RANSAC, ransacReprojThreshold=NOISE * reduction, maxIters=5000
        )
        if matrix is None:
            continue
        good = agree.ravel() > 0
        inliers = int((away[rows][good] <= about).sum())
        stretch = np.linalg.svd(matrix[:, :2], compute_uv=False)
        points = here[rows][good]
        spread = np.linalg.svd(points - points.mean(0), compute_uv=False)[1] / np.sqrt(len(points))
        sound = np.linalg.det(matrix[:, :2]) > 0 and stretch[0] < MOST_STRETCH * stretch[1] and spread > 0.1 * side
        if inliers >= INLIERS and sound:
            near = np.flatnonzero(rows)[good]
            near = near[away[near] <= about]
            return _steadied(matrix, here, there, near, side, reduction), inliers
    return None, inliers


def _steadied(matrix: Array, here: Array, there: Array, near: NDArray[np.int64], side: float, reduction: int) -> Array:
    """The affine map of the features `near` a polygon, its linear part drawn to that of the similarity of all around:
    as strongly as a single feature at the polygon's side draws. Few features leave shear and stretch open."""
    cv2.setRNGSeed(0)
    around, _ = cv2.estimateAffinePartial2D(
        here, there, method=cv2.RANSAC, ransacReprojThreshold=COARSE_NOISE * reduction
    )
    if around is None:
        return matrix
    middle, target = here[near].mean(0), there[near].mean(0)
    x, y = here[near] - middle, there[near] - target
    linear = np.linalg.solve(x.T @ x + side**2 * np.eye(2), x.T @ y + side**2 * around[:, :2].T).T
    return np.c_[linear, target - linear @ middle]


def _shifted(matrix: Array, here: Array, there: Array, shape: Any, reduction: int) -> Array:
    """The map moved to where the features in a polygon lead, if three or more, and at least half, agree on it."""
    inside = shapely.contains_xy(shape, here)
    if inside.sum() < 3:
        return matrix
    shift = there[inside] - here[inside] @ matrix[:, :2].T
    alike = ((shift[:, None] - shift) ** 2).sum(2) < (NOISE * reduction) ** 2
    most = alike[alike.sum(1).argmax()]
    if most.sum() < max(3, len(shift) / 2):
        return matrix
    return np.c_[matrix[:, :2], shift[most].mean(0)]


def _away(points: Array, low: Array, high: Array) -> Array:
    """(n,) distance from a box along the farther axis, px."""
    return np.maximum(np.maximum(low - points, points - high), 0).max(1)


def _within(box: Any, low: Array, high: Array) -> tuple[Array, Array]:
    """Two corners, not beyond those of a shapely box."""
    x0, y0, x1, y1 = box.bounds
    return np.maximum(low, [x0, y0]), np.minimum(high, [x1, y1])


def _moved(matrix: Array, shape: Any) -> Any:
    return shapely.transform(shape, lambda xy: _mapped(matrix, xy))


def _power(reduction: float) -> int:
    return int(2 ** np.ceil(np.log2(max(reduction, 1.0))))


def _mapped(matrix: Array, points: Array) -> Array:
    return np.asarray(points @ matrix[:, :2].T + matrix[:, 2])


# --- precision


def precision(folder: Path, sheet: Path | None) -> dict[str, Any]:
    """What the check says of each match, and of all; `precision.json` in the result's folder."""
    result = MatchResult.load(folder)
    start = perf_counter()
    with _photographs(result) as sources:
        check = Check(sources)
        found = [check.evidence(left) for left in result.matched_polygons()[0]]
        ious = [
            evidence.iou(right.shape) if evidence.shape is not None else None
            for evidence, right in zip(found, result.matched_polygons()[1], strict=True)
        ]
        if sheet is not None:
            PIL.Image.fromarray(_sheet(result, sources, found, ious)).save(sheet)
    decided = np.array([iou for iou in ious if iou is not None])
    right = int((decided >= SAME).sum())
    matches = [
        {"left": m.left, "right": m.right, "stage": m.stage, "iou": iou, "inliers": e.inliers, "why": e.why}
        for m, e, iou in zip(result.matches, found, ious, strict=True)
    ]
    content: dict[str, Any] = {
        "right": right,
        "wrong": len(decided) - right,
        "undecided": dict(Counter(e.why for e in found if e.why)),
        "precision": right / len(decided) if len(decided) else None,
        "mean_iou": float(decided.mean()) if len(decided) else None,
        "seconds": perf_counter() - start,
        "matches": matches,
    }
    report = document.stamped("zpm2-bench-precision/1", **content)
    (folder / "precision.json").write_text(json.dumps(report, indent=1))
    return report


def show_precision(report: dict[str, Any], worst: int = 15) -> None:
    undecided = sum(report["undecided"].values())
    row = [report[k] for k in ("right", "wrong")] + [undecided, report["precision"], report["mean_iou"]]
    print(table(["matches", "right", "wrong", "undecided", "precision", "mean IoU"], [[len(report["matches"]), *row]]))
    print(f"\nundecided: {report['undecided']}; {report['seconds']:.0f} s\n")
    decided = [m for m in report["matches"] if m["iou"] is not None]
    rows = [list(m.values())[:5] for m in sorted(decided, key=lambda m: m["iou"])[:worst]]
    print(table(["left", "right", "stage", "IoU", "features"], rows))


def _sheet(
    result: MatchResult, sources: tuple[Source, Source], found: Sequence[CandidateScores], ious: Sequence[float | None]
) -> NDArray[np.uint8]:
    """The worst 40 matches and the first 20 undecided ones: left polygon; right polygon, and where SIFT puts it."""
    pairs = list(zip(result.matches, *result.matched_polygons(), found, ious, strict=True))
    decided = sorted((p for p in pairs if p[4] is not None), key=lambda p: p[4])[:40]
    chosen = decided + [p for p in pairs if p[4] is None][:20]
    rows, captions = [], []
    for match, left, right, evidence, iou in chosen:
        shapes = [right.shape] if iou is None else [right.shape, evidence.shape]
        rows.append((_crop(sources[0], [left.shape]), _crop(sources[1], shapes)))
        captions.append(
            f"{match.left}-{match.right} {match.stage} " + (f"IoU {iou:.2f}" if iou is not None else evidence.why)
        )
    return contact_sheet(rows, captions, side=220, columns=4)


def _crop(source: Source, shapes: Sequence[Any]) -> Crop:
    bounds = (
        shapely.GeometryCollection(list(shapes)).intersection(shapely.box(0, 0, source.width, source.height)).bounds
    )
    window = crop_window(bounds, source.width, source.height, 0.4)
    side = max(window[2] - window[0], window[3] - window[1])
    size = [max(1, round((b - a) * min(1.0, 440 / side))) for a, b in zip(window[:2], window[2:], strict=True)]
    image = source.read(window, (size[0], size[1]))
    rings = [
        (np.array(part.exterior.coords) - window[:2]) * size[0] / (window[2] - window[0])
        for shape in shapes
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon"
    ]
    return Crop(image, rings)


@contextmanager
def _photographs(result: MatchResult) -> Iterator[tuple[Source, Source]]:
    if result.left.path is None or result.right.path is None:
        raise SystemExit("the result does not say where its photographs are")
    with opened(result.left.path, result.right.path) as sources:
        yield sources


# --- runs


def run(left: str, right: str, out: Path, preset: str, settings: Sequence[str]) -> dict[str, Any]:
    """One pair in a process of its own; `run.json` beside the result."""
    out.mkdir(parents=True, exist_ok=True)
    words = ["match", left, right, str(out), "--preset", preset, *(w for s in settings for w in ("--set", s))]
    start = perf_counter()
    child = subprocess.Popen([sys.executable, __file__, *words])
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(1)
    result = MatchResult.load(out)
    content: dict[str, Any] = {
        "settings": list(settings),
        "megapixels": [side.width * side.height / 1e6 for side in (result.left, result.right)],
        "polygons": [len(side.polygons) for side in (result.left, result.right)],
        "points": len(result.points),
        "matches": len(result.matches),
        "by_stage": dict(Counter(match.stage for match in result.matches)),
        "unmatched": [dict(Counter(side.unmatched.values())) for side in (result.left, result.right)],
        "wall": perf_counter() - start,
        "cpu": used.ru_utime + used.ru_stime,
        "seconds": dict(result.timings),
        "peak_mb": used.ru_maxrss // 1024,
        "warnings": list(result.warnings),
    }
    report = document.stamped("zpm2-bench-large-format/1", **content)
    (out / "run.json").write_text(json.dumps(report, indent=1))
    return report


def match(left: str, right: str, out: Path, preset: str, settings: Sequence[str]) -> None:
    """What `run` starts."""
    chosen = config.assign(config.preset(preset), ["tiles.mode=on", *settings])
    Matcher(chosen, say=lambda text: print(text, file=sys.stderr))(left, right).save(out)


def show_run(report: dict[str, Any]) -> None:
    columns = ["megapixels", "polygons", "points", "matches", "wall s", "CPU s", "peak MB"]
    both = [" + ".join(f"{each:.5g}" for each in report[name]) for name in ("megapixels", "polygons")]
    print(table(columns, [[*both, *(report[k] for k in ("points", "matches", "wall", "cpu", "peak_mb"))]]))
    print("\n" + table(list(report["seconds"]), [list(report["seconds"].values())]))
    print(f"\nmatches by stage: {report['by_stage']}")
    for side, reasons in zip(("left", "right"), report["unmatched"], strict=True):
        print(f"unmatched, {side}: {reasons}")


def growth(folders: Sequence[Path]) -> tuple[list[dict[str, Any]], float | None]:
    """The runs by size, and the exponent of time over megapixels, by least squares of their logarithms."""
    runs = [json.loads((folder / "run.json").read_text()) for folder in folders]
    runs.sort(key=lambda run: sum(run["megapixels"]))
    x, y = (
        np.log([float(value) for value in values])
        for values in zip(*((sum(r["megapixels"]), r["wall"]) for r in runs), strict=True)
    )
    return runs, float(np.polyfit(x, y, 1)[0]) if len(set(x)) > 1 else None


def show_growth(runs: Sequence[dict[str, Any]], exponent: float | None) -> None:
    rows = [
        [sum(r["megapixels"]), r["wall"], r["wall"] / sum(r["megapixels"]), r["peak_mb"], r["matches"]] for r in runs
    ]
    print(table(["megapixels", "wall s", "s per megapixel", "peak MB", "matches"], rows))
    print(f"\ntime grows with megapixels to the power of {exponent:.2f}" if exponent is not None else "\none size only")


# --- pyramid or fixed range

PARTS = "locate", "search_candidates", "possible_matches"
VARIANTS = {"full": (), "L = 2": ("global_match.max_layers=2",), "fixed range": ("global_match.search=fixed",)}


def bpm(folder: Path, repeat: int, settings: Sequence[str] = ()) -> list[list[Any]]:
    """A row for each variant: its best of `repeat` times, in turns; candidates, matches, precision, recall, ACR.
    `settings` are laid over those of the result."""
    result = MatchResult.load(folder)
    base = config.assign(Config.from_dict(result.config), ["guided.direction=off", *settings])
    sides = PolygonArrays(list(result.left.polygons)), PolygonArrays(list(result.right.polygons))
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in VARIANTS}
    with _photographs(result) as sources:
        for _ in range(repeat):
            for name, words in VARIANTS.items():
                runs[name].append(_matched(sources, sides, result, config.assign(base, words)))
        decided, true = _truth(Check(sources), sides)
    area = dict(zip(sides[0].ids.tolist(), sides[0].areas.tolist(), strict=True))
    of_truth = sum(area[left] for left, _ in true)
    rows = []
    for name, tried in runs.items():
        best = min(tried, key=lambda each: each["seconds"])
        fixed = min(each["seconds"] for each in runs["fixed range"])
        pairs = {(m.left, m.right) for m in best["matches"] if m.left in decided}
        hits, covered = len(pairs & true), sum(area[left] for left, _ in pairs)
        times = [best["seconds"], best["seconds"] / fixed, *(best[part] for part in PARTS)]
        scores = [hits / max(len(pairs), 1), hits / max(len(true), 1), covered / max(of_truth, 1.0)]
        rows.append([name, *times, best["candidates"], len(best["matches"]), *scores])
    return rows


def show_bpm(rows: Sequence[Sequence[Any]]) -> None:
    columns = ["search", "s", "of fixed range", "placing s", "candidates s", "comparing s"]
    print(table([*columns, "candidates", "matches", "precision", "recall", "ACR"], rows))


def _matched(
    sources: tuple[Source, Source], sides: tuple[PolygonArrays, PolygonArrays], result: MatchResult, chosen: Config
) -> dict[str, Any]:
    """The stages after the polygons once, with the seconds of each part."""
    spent: dict[str, Any] = {**dict.fromkeys(PARTS, 0.0), "candidates": 0}
    fresh = (
        PolygonArrays([replace(p) for p in sides[0].polygons]),
        PolygonArrays([replace(p) for p in sides[1].polygons]),
    )

    def timed(name: str) -> Callable[..., Any]:
        call = getattr(blocks, name)

        def of(*arguments: Any) -> Any:
            start = perf_counter()
            answer = call(*arguments)
            spent[name] += perf_counter() - start
            spent["candidates"] += len(answer) if name == "search_candidates" else 0
            return answer

        return of

    unasked = np.zeros(len(fresh[0]), bool), np.zeros(len(fresh[1]), bool)
    with mock.patch.multiple(blocks, **{name: timed(name) for name in PARTS}):
        start = perf_counter()
        forth = list(cells(fresh[0], result.points, chosen))
        warped = warped_by_cells(fresh[0], forth, chosen.local_match)
        spent["matches"] = blocks.match_blocks(blocks.LargePair(sources, fresh, unasked), forth, warped, chosen)
        spent["seconds"] = perf_counter() - start
    return spent


def _truth(check: Check, sides: tuple[PolygonArrays, PolygonArrays]) -> tuple[set[int], set[tuple[int, int]]]:
    """Ids of the left polygons that SIFT says something about, and the pairs of ids that are each other's best."""
    found = {p.id: check.evidence(p) for p in sides[0].polygons}
    decided = {id for id, evidence in found.items() if evidence.shape is not None}
    tree = shapely.STRtree(sides[1].shapes)
    best: dict[int, tuple[float, int]] = {}
    back: dict[int, tuple[float, int]] = {}
    for left in decided:
        for row in tree.query(found[left].shape):
            right, iou = int(sides[1].ids[row]), found[left].iou(sides[1].shapes[row])
            best[left] = max(best.get(left, (0.0, -1)), (iou, right))
            back[right] = max(back.get(right, (0.0, -1)), (iou, left))
    return decided, {(left, right) for left, (iou, right) in best.items() if iou >= SAME and back[right][1] == left}


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    made = commands.add_parser("mosaic", help="real pairs side by side, as large as wanted")
    made.add_argument("out", type=Path, nargs=2, metavar="OUT")
    made.add_argument("photographs", type=Path, nargs="+", metavar="PAIR_LEFT PAIR_RIGHT")
    made.add_argument("--size", type=_size, required=True, metavar="WIDTHxHEIGHT")
    made.add_argument("--crs", default="", help="such as EPSG:32633; default: no georeference")
    made.add_argument("--gsd", type=float, default=0.1, help="m per px, with --crs")
    for name, about in (("run", "match a pair, measure time and memory"), ("match", "what run starts")):
        one = commands.add_parser(name, help=about)
        one.add_argument("left")
        one.add_argument("right")
        one.add_argument("out", type=Path)
        one.add_argument("--preset", default="default")
        one.add_argument("--set", dest="settings", action="append", default=[], metavar="stage.field=value")
    checked = commands.add_parser("precision", help="judge a result by SIFT")
    checked.add_argument("out", type=Path)
    checked.add_argument("--sheet", type=Path, help="picture of the worst matches")
    commands.add_parser("growth", help="time over megapixels").add_argument("out", type=Path, nargs="+")
    compared = commands.add_parser("bpm", help="pyramid or fixed range, on the polygons of a result")
    compared.add_argument("out", type=Path)
    compared.add_argument("--repeat", type=int, default=3)
    compared.add_argument("--set", dest="settings", action="append", default=[], metavar="stage.field=value")
    o = parser.parse_args()
    if o.command == "mosaic":
        if len(o.photographs) % 2:
            parser.error("photographs come in pairs")
        mosaic.write(list(zip(o.photographs[::2], o.photographs[1::2], strict=True)), o.out, o.size, o.crs, o.gsd)
    elif o.command == "match":
        match(o.left, o.right, o.out, o.preset, o.settings)
    elif o.command == "run":
        show_run(run(o.left, o.right, o.out, o.preset, o.settings))
    elif o.command == "precision":
        show_precision(precision(o.out, o.sheet))
    elif o.command == "growth":
        show_growth(*growth(o.out))
    else:
        show_bpm(bpm(o.out, o.repeat, o.settings))


if __name__ == "__main__":
    main()
