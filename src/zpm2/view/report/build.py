"""The report of a matched pair."""

import gzip
import json
import os
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import RasterConfig
from zpm2.errors import Failed
from zpm2.formats.registry import PairResult
from zpm2.model import SIDES, Image
from zpm2.photos.reopen import pixels
from zpm2.view.report import alignment, content
from zpm2.view.report.assets import data_url, render

LONGEST = 1600  # px, the longer side of a photograph in the page
HELD = 16_000_000  # bytes of the matches.json that the page itself holds, packed; a larger one has to lie beside it
QUALITY = 85  # 1..100, of the pictures (WebP)

Pixels = NDArray[np.uint8]


def report(result: PairResult, document: Mapping[str, object], config: RasterConfig) -> str:
    """The HTML of `report.html`: the same result gives the same text. Two runs differ in the element `timings` only.

    document: the content of `matches.json`, which the page offers for download. config: how the photographs are read;
    they are read at the size shown. `InputError` where one is no longer where it was.
    """
    sides = result.left, result.right
    shown = [_shown(pixels(side, name, config, LONGEST)) for side, name in zip(sides, SIDES, strict=True)]
    sizes = [(picture.shape[1], picture.shape[0]) for picture in shown]
    left_scale, right_scale = (
        np.array(size) / (side.width, side.height) for size, side in zip(sizes, sides, strict=True)
    )
    scales = left_scale, right_scale
    aligned = {
        "points": alignment.by_points(shown[1], result.points, scales, sizes[0]),
        "homography": alignment.by_homography(shown[1], result.homography, scales, sizes[0]),
    }
    pictures = [{"name": name, "url": _url(picture)} for name, picture in zip(SIDES, shown, strict=True)]
    pictures += [{"name": how, "url": _url(made.rgba)} for how, made in aligned.items() if not isinstance(made, Failed)]
    data = content.pair(result, scales) | {
        "steps": content.STEPS,
        "scales": [scale.tolist() for scale in scales],
        "aligned": {how: str(made) if isinstance(made, Failed) else None for how, made in aligned.items()},
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
        timings=json.dumps(document["timings"]),
    )


def _shown(image: Image) -> Pixels:
    """The pixels, at most `LONGEST` px long."""
    factor = LONGEST / max(image.width, image.height)
    if factor >= 1:
        return image.rgb
    size = max(1, round(image.width * factor)), max(1, round(image.height * factor))
    return np.asarray(cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _url(picture: Pixels) -> str:
    """(h, w, 3 or 4) RGB or RGBA as an address."""
    order = cv2.COLOR_RGB2BGR if picture.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
    _, packed = cv2.imencode(".webp", cv2.cvtColor(picture, order), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    return data_url("image/webp", packed.tobytes())
