"""Photographs for COLMAP, which reads fewer formats than zpm2, and some of them differently."""

from pathlib import Path

import numpy as np

from zpm2.formats.colmap import require_pycolmap
from zpm2.photos.images import read_image
from zpm2.photos.pictures import png

DECODER_DIFFERENCE = 2.0  # grey levels: two decoders of one JPEG differ by less on average


def as_png(path: Path) -> bytes | None:
    """The pixels of a photograph as PNG, black where there is no data; None where COLMAP reads the same from the
    file itself, and its EXIF data too. COLMAP recognises a PNG whatever its file is called."""
    image = read_image(path)
    bitmap = require_pycolmap().Bitmap.read(str(path), True)
    if bitmap is not None and image.valid is None and (bitmap.width, bitmap.height) == (image.width, image.height):
        seen = np.asarray(bitmap.to_array())
        if np.abs(seen.astype(np.int16) - image.rgb).mean() < DECODER_DIFFERENCE:
            return None
    return png(image.rgb)
