"""Regions of a photograph of any size: by windows, each with the part of the other photograph that shows it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.carry.outcome import Outcome
from zpm2.carry.places import places
from zpm2.config import Config
from zpm2.global_match import InitialGeometry, initial_geometry
from zpm2.global_match.pair_points import PointFinder
from zpm2.model import PointMatches
from zpm2.photos.raster import Window
from zpm2.photos.source import Source, reduced
from zpm2.runtime import StageTimer
from zpm2.tiled.view import TileView, applied_turn, read_view, reduced_size

Array = NDArray[np.float64]
Shapes = NDArray[np.object_]


def overview(
    sources: tuple[Source, Source], finder: PointFinder, config: Config, timer: StageTimer
) -> tuple[InitialGeometry, list[str]]:
    """The geometry of the pair from both photographs reduced, px of the photographs; and notes."""
    images = reduced(sources[0], config.points.max_size), reduced(sources[1], config.points.max_size)
    scale = [np.array([s.width / i.width, s.height / i.height]) for s, i in zip(sources, images, strict=True)]
    looked = finder(images, timer)
    found = looked.initial.points
    points = PointMatches(found.left * scale[0], found.right * scale[1], found.score)
    coarse = max(1.0, *(float(each.max()) for each in scale))  # px of the photographs for one that was seen
    settings = replace(
        config.global_match,
        epipolar_px=config.global_match.epipolar_px * coarse,
        homography_px=config.global_match.homography_px * coarse,
    )
    return initial_geometry(points, settings, config.seed), looked.notes


def window_pairs(
    sources: tuple[Source, Source], shapes: Shapes, initial: InitialGeometry, config: Config
) -> Iterator[tuple[NDArray[np.intp], tuple[TileView, TileView] | None]]:
    """The windows that hold regions, row by row: the rows of the regions, and that part of the left and of the right
    photograph, at about one ground resolution and upright to each other. None where the right one does not show it, or
    nothing tells where it does."""
    side, margin = config.carry.window, config.carry.window * config.carry.window_margin
    centers = np.c_[shapely.get_x(shapely.centroid(shapes)), shapely.get_y(shapely.centroid(shapes))]
    cell = np.floor(centers / side).astype(np.int64)
    known, _ = initial.forward()
    coarse = max(1.0, max(sources[0].width, sources[0].height) / config.points.max_size)
    settings = replace(config.carry, agree_px=config.carry.agree_px * coarse)
    for key in np.unique(cell[:, ::-1], axis=0)[:, ::-1]:
        rows = np.flatnonzero((cell == key).all(1))
        x0, y0, x1, y1 = shapely.total_bounds(shapes[rows])
        corner = key * side
        window = _within(
            (min(x0, corner[0]) - margin, min(y0, corner[1]) - margin),
            (max(x1, corner[0] + side) + margin, max(y1, corner[1] + side) + margin),
            sources[0],
        )
        box = np.array([shapely.box(*window)], object)
        place = places(box, initial, settings, config.local_match)
        if (
            not initial.supported
            or not len(known)
            or place.shapes[0].is_empty
            or place.trust[0] < config.carry.min_trust
        ):
            yield rows, None
            continue
        linear = geometry.homography_jacobian(
            place.maps[0], np.array([[(window[0] + window[2]) / 2, (window[1] + window[3]) / 2]])
        )[0]
        bounds = place.shapes[0].bounds
        other = _within((bounds[0] - margin, bounds[1] - margin), (bounds[2] + margin, bounds[3] + margin), sources[1])
        if min(other[2] - other[0], other[3] - other[1]) < config.carry.window_margin * side / 2:
            yield rows, None
            continue
        scale = float(np.sqrt(abs(np.linalg.det(linear))))
        turn = applied_turn(float(np.arctan2(linear[1, 0] - linear[0, 1], linear[0, 0] + linear[1, 1])), config.tiles)
        views = (
            read_view(sources[0], window, reduced_size(window, _reduction(scale, config.carry.zoom_step))),
            read_view(sources[1], other, reduced_size(other, scale if scale > 1 else 1.0), -turn),
        )
        yield rows, views


def _reduction(scale: float, step: float) -> float:
    """How much a left window is reduced where the right photograph has `scale` times its resolution. A power of `step`:
    so a window is the same picture for several right photographs, and is looked at once."""
    return float(step ** round(math.log(max(1 / scale, 1.0)) / math.log(step)))


def _within(low: Sequence[float], high: Sequence[float], source: Source) -> Window:
    x0, y0 = (int(np.clip(np.floor(v), 0, limit)) for v, limit in zip(low, (source.width, source.height), strict=True))
    x1, y1 = (int(np.clip(np.ceil(v), 0, limit)) for v, limit in zip(high, (source.width, source.height), strict=True))
    return x0, y0, x1, y1


def to_view(shapes: Shapes, view: TileView) -> Shapes:
    """Shapes, px of the photograph, in px of a view."""
    return np.asarray(shapely.transform(shapes, lambda xy: geometry.project(view.from_px, xy)), object)


def from_view(each: Outcome, view: TileView) -> Outcome:
    """An outcome, px of a view of the right photograph, in px of the photograph."""
    scale = float(np.sqrt(abs(np.linalg.det(view.to_px[:2, :2]))))
    shape = None if each.shape is None else shapely.transform(each.shape, view.points)
    place = each.place and tuple(view.points(np.array([each.place]))[0].tolist())
    others = tuple((*view.points(np.array([(x, y)]))[0].tolist(), agreement) for x, y, agreement in each.alternatives)
    sigma = None if each.sigma is None else each.sigma * scale
    return replace(each, shape=shape, place=place, sigma=sigma, alternatives=others)
