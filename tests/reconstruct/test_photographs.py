"""What COLMAP is given to see is what we read."""

import cv2
import numpy as np
import PIL.Image
import pytest

from zpm2.formats import read_image
from zpm2.reconstruct.photographs import as_png

pycolmap = pytest.importorskip("pycolmap")
RGB = cv2.resize(np.random.default_rng(0).integers(0, 256, (12, 16, 3), np.uint8), (160, 120))


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif", "a.bmp"])
def test_ordinary_photographs_stay_as_they_are(tmp_path, name):
    PIL.Image.fromarray(RGB).save(tmp_path / name)
    assert as_png(tmp_path / name) is None


@pytest.mark.parametrize(
    "kind", ["deep.png", "deep.tif", "clear.png", "a.webp", "a.jp2", "a.avif", "five bands.tif", "floats.tif"]
)
def test_others_are_given_as_png_under_their_own_name(tmp_path, kind):
    path = tmp_path / kind
    if kind == "deep.png" or kind == "deep.tif":
        assert cv2.imwrite(str(path), RGB.astype(np.uint16) * 3 + 200)
    elif kind == "clear.png":
        PIL.Image.fromarray(np.dstack([RGB, np.where(RGB[..., 0] > 99, 255, 0).astype(np.uint8)])).save(path)
    elif kind in ("five bands.tif", "floats.tif"):
        rasterio = pytest.importorskip("rasterio")
        values = RGB[..., [0, 1, 2, 0, 1]][..., : 5 if "five" in kind else 1].astype(
            "uint8" if "five" in kind else "f4"
        )
        shape = {"width": 160, "height": 120, "count": values.shape[2], "dtype": values.dtype}
        with rasterio.open(path, "w", driver="GTiff", **shape) as file:
            file.write(np.moveaxis(values - (0 if "five" in kind else 300), -1, 0))
    else:
        PIL.Image.fromarray(RGB).save(path)
    expected = read_image(path).rgb
    pixels = as_png(path)
    assert pixels is not None
    path.write_bytes(pixels)
    assert np.array_equal(np.asarray(pycolmap.Bitmap.read(str(path), True).to_array()), expected)
    assert np.array_equal(read_image(path).rgb, expected)
