"""The pictures of a result, from its photographs and polygons."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zpm2.config import RasterConfig
from zpm2.errors import ConfigError
from zpm2.formats.registry import PairResult
from zpm2.model import SIDES, ImagePolygons, Polygon
from zpm2.photos.reopen import pixels, reopened
from zpm2.photos.source import Source
from zpm2.view.contact import Crop, contact_sheet, crop_window
from zpm2.view.overlay import overlay as draw_overlay
from zpm2.view.overlay import unmatched as draw_unmatched

Pixels = NDArray[np.uint8]
CROP = 300  # px, the longest side at which a crop for the contact sheet is read


def overlay(result: PairResult, config: RasterConfig, max_width: int) -> Pixels:
    """(h, w, 3) both photographs with matched polygons in the same colour and the same number."""
    return draw_overlay(*_shown(result, config, max_width), result.matches, max_width)


def unmatched(result: PairResult, config: RasterConfig, max_width: int) -> Pixels:
    """(h, w, 3) both photographs with the polygons that have no partner, coloured by why."""
    return draw_unmatched(*_shown(result, config, max_width), result.matches, max_width)


def sheet(result: PairResult, config: RasterConfig, count: int, seed: int) -> Pixels:
    """(h, w, 3) up to `count` random matches, each with its two polygons close up. Only what is shown is read.
    `ConfigError` for a `count` or a `seed` under 0."""
    if not min(count, seed) >= 0:
        raise ConfigError(f"a contact sheet takes a number of matches and a seed of 0 or more, not {count}, {seed}")
    chosen = np.random.default_rng(seed).permutation(len(result.matches))[:count]
    matches = [result.matches[k] for k in sorted(chosen)]
    crops = []
    for name, side in zip(SIDES, (result.left, result.right), strict=True):
        polygons = {polygon.id: polygon for polygon in side.polygons}
        with reopened(side, name, config) as source:
            crops.append([crop(source, side.width, polygons[getattr(match, name)]) for match in matches])
    captions = [f"match {match.id}   (right {match.right})   {match.confidence:.2f}" for match in matches]
    return contact_sheet(list(zip(*crops, strict=True)), captions)


def all_pictures(result: PairResult, config: RasterConfig, max_width: int, count: int) -> dict[str, Pixels]:
    """Those that are saved with a result, by file name; the contact sheet only of photographs shown reduced. Each
    photograph is read once for both pictures of the whole, and again by windows for the contact sheet."""
    shown = _shown(result, config, max_width)
    found = {
        "overlay.png": draw_overlay(*shown, result.matches, max_width),
        "unmatched.png": draw_unmatched(*shown, result.matches, max_width),
    }
    if any(side.image is not None and side.image.width < side.width for side in (result.left, result.right)):
        found["contact.png"] = sheet(result, config, count, 0)
    return found


def _shown(result: PairResult, config: RasterConfig, longest: int) -> tuple[ImagePolygons, ImagePolygons]:
    """Both sides with their photographs, `longest` px or more. `ConfigError` for one under 1."""
    if not longest >= 1:
        raise ConfigError(f"a picture is at least 1 px wide, not {longest}")
    left, right = (
        replace(side, image=pixels(side, name, config, longest))
        for name, side in zip(SIDES, (result.left, result.right), strict=True)
    )
    return left, right


def crop(source: Source, width: int, polygon: Polygon) -> Crop:
    """A polygon of a photograph of `width` px with its surroundings; `source` may be a reduced version of it."""
    scale = source.width / width
    rings = [ring * scale for ring in (polygon.exterior, *polygon.holes)]
    bounds = *rings[0].min(0), *rings[0].max(0)
    x0, y0, x1, y1 = window = crop_window(bounds, source.width, source.height)
    reduction = max(1.0, max(x1 - x0, y1 - y0) / CROP)
    size = max(1, round((x1 - x0) / reduction)), max(1, round((y1 - y0) / reduction))
    factor = np.array(size) / (x1 - x0, y1 - y0)
    return Crop(source.read(window, size), [(ring - (x0, y0)) * factor for ring in rings])
