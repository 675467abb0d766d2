"""The report of a matched pair."""

import gzip
import json
import os
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import RasterConfig
from zpm2.errors import Failed
from zpm2.formats.convert import Members
from zpm2.formats.registry import PairResult
from zpm2.formats.saving import REPORT, TILES
from zpm2.model import SIDES, Image
from zpm2.photos.reopen import pixels, reopened
from zpm2.view.report import alignment, content, tiles
from zpm2.view.report.assets import data_url, picture_url, render
from zpm2.view.report.content import Words

LONGEST = 1600  # px, the longer side of a photograph in the page
HELD = 16_000_000  # bytes of the matches.json that the page itself holds, packed; a larger one has to lie beside it
LARGE = 2400  # px, the longer side from which on a photograph can be seen at full size, from files beside the page
PLANES = ("epipolar", "homography")  # ways to lay the right photograph over the left one as a whole
WORDS = Words()

Pixels = NDArray[np.uint8]


def report(result: PairResult, document: Members, config: RasterConfig) -> str:
    """The HTML of `report.html` alone: the same result gives the same text. Two runs differ in the element `timings`
    only.

    document: the content of `matches.json`, which the page offers for download. config: how the photographs are read;
    they are read at the size shown. `InputError` where one is no longer where it was.
    """
    return _page(result, document, config, WORDS, [0, 0])


def files(
    result: PairResult, document: Members, config: RasterConfig, words: Words = WORDS
) -> Iterator[tuple[str, str | bytes]]:
    """Name and content of `report.html`, after those of the tiles of large photographs; arguments as of `report`."""
    counts = []
    for side, name in zip((result.left, result.right), SIDES, strict=True):
        counts.append(0)
        if max(side.width, side.height) <= LARGE:
            continue
        with reopened(side, name, config) as source:
            if source.width == side.width:  # else there is a reduced one in memory and no file
                counts[-1] = tiles.levels(side.width, side.height, LONGEST)
                yield from ((f"{TILES}/{name}-{tile}", packed) for tile, packed in tiles.tiles(source, counts[-1]))
    yield REPORT, _page(result, document, config, words, counts)


def _page(result: PairResult, document: Members, config: RasterConfig, words: Words, counts: Sequence[int]) -> str:
    """counts: of the levels of tiles of either side."""
    sides = result.left, result.right
    shown = [_shown(pixels(side, name, config, LONGEST)) for side, name in zip(sides, SIDES, strict=True)]
    sizes = [(picture.shape[1], picture.shape[0]) for picture in shown]
    left_scale, right_scale = (
        np.array(size) / (side.width, side.height) for size, side in zip(sizes, sides, strict=True)
    )
    scales = left_scale, right_scale
    planes = alignment.better(alignment.rectifying(result.fundamental, result.points), result.homography, result.points)
    aligned = {
        "points": alignment.by_points(shown[1], result.points, scales, sizes[0]),
        **{
            how: alignment.by_homography(shown[1], plane, scales, sizes[0])
            for how, plane in zip(PLANES, planes, strict=True)
        },
    }
    pictures = [{"name": name, "url": picture_url(picture)} for name, picture in zip(SIDES, shown, strict=True)]
    pictures += [
        {"name": how, "url": picture_url(made)} for how, made in aligned.items() if not isinstance(made, Failed)
    ]
    sharpest = [np.ones(2) if count else scale for count, scale in zip(counts, scales, strict=True)]
    data = content.pair(result, (sharpest[0], sharpest[1]), words) | {
        "tiles": [{"folder": TILES, "side": tiles.SIDE, "levels": count} if count else None for count in counts],
        "aligned": {how: str(made) if isinstance(made, Failed) else None for how, made in aligned.items()},
        "within": {how: alignment.within(plane, result.points) for how, plane in zip(PLANES, planes, strict=True)},
        "most": alignment.MOST,
        "run": content.run(document),
    }
    names = [os.path.basename(side.path) if side.path else name for side, name in zip(sides, SIDES, strict=True)]
    text = json.dumps({**document, "timings": {}}, allow_nan=False).encode()  # the page puts them in again
    held = data_url("application/gzip", gzip.compress(text, 6, mtime=0)) if len(text) <= HELD else ""
    return render(
        "report.html",
        "main.js",
        data,
        title=f"{names[0]} and {names[1]}: {len(result.matches)} matches",
        names=names,
        pictures=pictures,
        document=held,
        document_name=words.document,
        timings=json.dumps(document["timings"]),
        own="'self' file:" if any(counts) else "",
    )


def _shown(image: Image) -> Pixels:
    """The pixels, at most `LONGEST` px long."""
    factor = LONGEST / max(image.width, image.height)
    if factor >= 1:
        return image.rgb
    size = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    return np.asarray(cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
