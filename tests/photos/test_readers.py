"""One file, whoever reads it: as a whole or by windows, GDAL or Pillow, the same pixels and the same gaps."""

import itertools

import numpy as np
import PIL.Image
import pytest

from zpm2.config import RasterConfig
from zpm2.errors import ConfigError, InputError, MissingDependency
from zpm2.formats import read_image
from zpm2.photos import source
from zpm2.photos.listing import image_size
from zpm2.photos.raster import open_raster
from zpm2.photos.source import InMemoryPhoto, open_source

rasterio = pytest.importorskip("rasterio")
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
from rasterio import shutil  # noqa: E402
from rasterio.enums import ColorInterp  # noqa: E402
from rasters import write  # noqa: E402

RNG = np.random.default_rng(0)
SCENE = np.kron(RNG.integers(0, 200, (5, 12, 16)), np.ones((1, 6, 6))) + RNG.integers(0, 50, (5, 72, 96))
GAP = np.zeros((72, 96), bool)
GAP[:, :20] = True
GAP[30:40, 50:60] = True


def scene(dtype, bands):
    """The scene in values of a type, most of them beyond 8 bit."""
    dtype = np.dtype(dtype)
    if dtype.itemsize == 1:
        return (SCENE[:bands] - (128 if dtype.kind == "i" else 0)).astype(dtype)
    return (SCENE[:bands] * 7 + (300 if dtype.kind != "i" else -300)).astype(dtype)


def likeness(image, bands, where=None):
    """Correlation of the grey values with the scene's."""
    true = np.repeat(SCENE[:1], 3, 0) if bands < 3 else SCENE[:3]
    where = np.ones(GAP.shape, bool) if where is None else where
    return np.corrcoef(image.rgb[where].ravel(), np.moveaxis(true, 0, -1)[where].ravel())[0, 1]


def agree(path, bands=()):
    """What the whole file gives, which all other ways to read it must give too."""
    image = read_image(path, config=RasterConfig(bands=bands))
    with open_raster(path, bands=bands) as opened:
        again, part = opened.read(), opened.read((10, 5, 90, 60))
        assert opened.notes == tuple(note for note in image.notes if "no pixel was fully transparent" not in note)
    valid = np.ones(image.rgb.shape[:2], bool) if image.valid is None else image.valid
    for other, (x0, y0, x1, y1) in ((again, (0, 0, image.width, image.height)), (part, (10, 5, 90, 60))):
        assert np.array_equal(other.rgb, image.rgb[y0:y1, x0:x1])
        known = np.ones(other.rgb.shape[:2], bool) if other.valid is None else other.valid
        assert np.array_equal(known, valid[y0:y1, x0:x1])
    return image


TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64")


@pytest.mark.parametrize("compress", [None, "deflate", "lzw", "zstd", "lerc"])
@pytest.mark.parametrize("dtype", TYPES)
def test_any_number_of_bands_of_any_type(tmp_path, dtype, compress):
    if compress == "lerc" and dtype in ("uint64", "int64"):
        pytest.skip("LERC has no such type")
    for bands in range(1, 6):
        path = write(tmp_path / "a.tif", scene(dtype, bands), **({"compress": compress} if compress else {}))
        image = agree(path)
        assert likeness(image, bands) > 0.999
        assert image.valid is None
        assert image_size(path) == (96, 72)
        only = RasterConfig(bands=(bands,))
        assert np.array_equal(agree(path, (bands,)).rgb[..., 0], read_image(path, config=only).rgb[..., 2])


NODATA = {
    "uint8": (0, 255),
    "int8": (-128,),
    "uint16": (0, 65535),
    "int16": (-9999, -32768),
    "int32": (-(2**31),),
    "float32": (-3.4028234663852886e38, -9999, 0, float("nan")),
    "float64": (-1.7976931348623157e308, 1e20, float("nan")),
}


@pytest.mark.parametrize(("dtype", "nodata"), [(kind, value) for kind, values in NODATA.items() for value in values])
@pytest.mark.parametrize("bands", [1, 3, 5])
def test_declared_nodata(tmp_path, dtype, nodata, bands):
    values = scene(dtype, bands)
    values = np.clip(values, values.min() + 1, values.max() - 1)
    values[:, GAP] = np.array(nodata, dtype)
    image = agree(write(tmp_path / "a.tif", values, nodata=nodata))
    assert np.array_equal(image.valid, ~GAP)
    assert not image.rgb[GAP].any()
    assert likeness(image, bands, ~GAP) > 0.99
    share = GAP.mean()
    assert any(f"left out: {share:.1%}" in note for note in image.notes)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("bands", [1, 3, 5])
def test_internal_masks(tmp_path, dtype, bands):
    image = agree(write(tmp_path / "a.tif", scene(dtype, bands), mask=~GAP))
    assert np.array_equal(image.valid, ~GAP)
    assert likeness(image, bands, ~GAP) > 0.99


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_nan_is_no_data_in_a_file_and_a_mistake_in_an_array(tmp_path, dtype):
    for bad in (np.nan, np.inf, -np.inf):
        values = scene(dtype, 1)
        values[:, GAP] = bad
        image = agree(write(tmp_path / "a.tif", values))
        assert np.array_equal(image.valid, ~GAP)
        with pytest.raises(InputError, match="NaN or infinite"):
            read_image(values[0])
    values[:] = np.nan
    with pytest.raises(InputError, match="no pixel with data"):
        read_image(write(tmp_path / "a.tif", values))


@pytest.mark.parametrize(
    ("dtype", "fill"),
    [
        ("int16", -9999),
        ("uint16", 65535),
        ("uint16", 0),
        ("float32", -9999),
        ("float64", -3.4e38),
        ("int32", 2**31 - 1),
    ],
)
@pytest.mark.parametrize("bands", [1, 3])
def test_an_undeclared_value_that_fills_the_border_is_no_data_and_said_loudly(tmp_path, dtype, fill, bands):
    frame = np.ones(GAP.shape, bool)
    frame[1:-1, 1:-1] = False
    for gap in (GAP, frame):
        values = scene(dtype, bands)
        values[:, gap] = fill
        image = agree(write(tmp_path / "a.tif", values))
        assert np.array_equal(image.valid, ~gap)
        assert likeness(image, bands, ~gap) > 0.99
        assert any(f"{fill:g}" in note and "not declared" in note for note in image.notes)


def test_two_values_may_fill_the_border(tmp_path):
    values = scene("uint16", 3)
    values[:, :, :10] = 65535
    values[:, :, 80:] = 0
    image = agree(write(tmp_path / "a.tif", values))
    assert np.array_equal(image.valid, np.broadcast_to((np.arange(96) >= 10) & (np.arange(96) < 80), (72, 96)))


def test_what_is_no_fill_stays(tmp_path):
    inside = scene("uint16", 1)
    inside[:, 20:60, 20:80] = 65535  # does not touch the border, but is far from all others
    image = agree(write(tmp_path / "a.tif", inside))
    assert image.valid is None
    assert any("65535, far from all others" in note for note in image.notes)
    bright = scene("uint16", 1)
    bright[0][bright[0] > np.percentile(bright, 98)] = 2000  # burnt out here and there, near to all others
    image = agree(write(tmp_path / "b.tif", bright))
    assert image.valid is None
    assert len(image.notes) == 1
    flat = np.full((1, 72, 96), 1000, np.uint16)
    assert agree(write(tmp_path / "c.tif", flat)).valid is None
    eight = scene("uint8", 1)
    eight[:, GAP] = 0
    assert agree(write(tmp_path / "d.tif", eight)).valid is None


def test_sixteen_bit_jpeg_2000_and_plain_vrt(tmp_path):
    if "JP2OpenJPEG" not in rasterio.drivers.raster_driver_extensions().values():
        pytest.skip("this GDAL has no JPEG 2000")
    options = {"driver": "JP2OpenJPEG", "quality": "100", "reversible": "YES"}
    for bands in (1, 3, 4):
        assert likeness(agree(write(tmp_path / "a.jp2", scene("uint16", bands), **options)), bands) > 0.999
    shutil.copy(write(tmp_path / "a.tif", scene("int16", 4)), tmp_path / "a.vrt", driver="VRT")
    assert likeness(agree(tmp_path / "a.vrt"), 4) > 0.999


def test_complex_values_are_called_so(tmp_path):
    path = write(tmp_path / "a.tif", np.ones((1, 72, 96), np.complex64))
    for call in (read_image, open_source):
        with pytest.raises(InputError, match="complex values: give a raster of their magnitude"):
            call(path)


def test_white_may_be_zero(tmp_path):
    for dtype in ("uint8", "uint16"):
        image = agree(write(tmp_path / "a.tif", scene(dtype, 1), photometric="MINISWHITE"))
        assert likeness(image, 1) < -0.999


def test_colour_models_of_tiff(tmp_path):
    picture = PIL.Image.fromarray(np.moveaxis(SCENE[:3], 0, -1).astype(np.uint8))
    for mode in ("YCbCr", "CMYK"):
        picture.convert(mode).save(tmp_path / "a.tif")
        image = agree(tmp_path / "a.tif")
        assert f"converted from {mode}" in image.notes[0]
        assert likeness(image, 3) > 0.99


# --- transparency


def transparent(kind):
    """A picture with `GAP` transparent, and colours in it that must not be seen."""
    rgb = np.moveaxis(SCENE[:3], 0, -1).astype(np.uint8)
    alpha = np.where(GAP, 0, 255).astype(np.uint8)
    if kind == "RGBA":
        return PIL.Image.fromarray(np.dstack([rgb, alpha]))
    if kind == "LA":
        return PIL.Image.merge("LA", [PIL.Image.fromarray(rgb[..., 0]), PIL.Image.fromarray(alpha)])
    if kind == "P":
        index = np.where(GAP, 9, rgb[..., 0] // 32).astype(np.uint8)
        picture = PIL.Image.fromarray(index).convert("P")
        picture.putpalette([k * 25 % 256 for k in range(256) for _ in range(3)])
        picture.info["transparency"] = 9
        return picture
    key = np.where(GAP[..., None], 3, np.maximum(rgb, 4)).astype(np.uint8)  # a colour that means transparent
    picture = PIL.Image.fromarray(key[..., 0] if kind == "L" else key)
    picture.info["transparency"] = 3 if kind == "L" else (3, 3, 3)
    return picture


@pytest.mark.parametrize(
    ("kind", "format"),
    [
        *itertools.product(("RGBA", "LA", "P", "L", "RGB"), ("PNG", "memory")),
        ("P", "GIF"),
        *itertools.product(("RGBA", "LA"), ("TIFF", "WEBP", "JPEG2000")),
        *itertools.product(("RGBA",), ("ICO", "TGA", "AVIF", "array", "deep array", "float array", "deep PNG")),
    ],
)
@pytest.mark.parametrize("with_rasterio", [True, False])
def test_transparent_is_no_data(tmp_path, monkeypatch, kind, format, with_rasterio):
    if not with_rasterio:
        monkeypatch.setattr(source, "open_raster", missing)
    picture, path = transparent(kind), tmp_path / "picture"
    rgba = np.asarray(picture)
    if format == "memory":
        given = picture
    elif "array" in format:
        given = {"array": rgba, "deep array": rgba.astype(np.uint16) * 257, "float array": rgba / 255}[format]
    elif format == "deep PNG":
        deep = np.moveaxis(rgba, -1, 0).astype(np.uint16) * 257
        given = write(path, deep, driver="PNG")
    else:
        options = {"lossless": True, "exact": True} if format == "WEBP" else {}
        if format == "AVIF":
            pytest.importorskip("PIL._avif")
        if format in ("PNG", "GIF") and "transparency" in picture.info:
            options["transparency"] = picture.info["transparency"]
        if format == "ICO":
            options["sizes"] = [picture.size]
        picture.save(path, format, **options)
        given = path
    image = read_image(given)
    if format in ("AVIF",):
        assert (image.valid == ~GAP).mean() > 0.99  # lossy, its alpha too
    else:
        assert np.array_equal(image.valid, ~GAP)
    assert not image.rgb[~image.valid].any()
    assert any("Pixels without data" in note and "alpha" in note for note in image.notes)


def test_alpha_of_a_raster_by_its_mark(tmp_path):
    colors = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
    for dtype, opaque in (("uint8", 255), ("uint16", 65535)):
        values = np.concatenate([scene(dtype, 3), np.where(GAP, 0, opaque).astype(dtype)[None]])
        image = agree(write(tmp_path / "a.tif", values, colors=colors, alpha="YES", photometric="RGB"))
        assert np.array_equal(image.valid, ~GAP)


def test_what_is_half_transparent_is_data():
    rgba = np.asarray(transparent("RGBA")).copy()
    rgba[..., 3] = np.maximum(rgba[..., 3], 1)
    image = read_image(rgba)
    assert (image.valid, image.notes) == (None, ("The alpha band was dropped; no pixel was fully transparent.",))
    assert np.array_equal(image.rgb, rgba[..., :3])
    rgba[..., 3] = 0
    with pytest.raises(InputError, match="no pixel with data"):
        read_image(rgba)


# --- which library


def missing(*_, **__):
    raise MissingDependency("rasterio is missing")


@pytest.mark.parametrize("format", ["PNG", "JPEG", "BMP", "WEBP", "GIF", "TIFF", "PPM"])
@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_ordinary_pictures_are_what_pillow_unpacks(tmp_path, format, mode):
    picture = PIL.Image.fromarray(np.moveaxis(SCENE[:3], 0, -1).astype(np.uint8)).convert(mode)
    picture.save(tmp_path / "a", format)
    with PIL.Image.open(tmp_path / "a") as saved:
        expected = np.asarray(saved.convert("RGB"))
    image = read_image(tmp_path / "a")
    assert np.array_equal(image.rgb, expected)
    assert image.valid is None
    assert format == "GIF" or image.notes == ()


@pytest.mark.parametrize("format", ["AVIF", "ICO", "TGA", "PCX", "DDS", "QOI", "SGI"])
def test_what_only_pillow_knows_is_read(tmp_path, format):
    picture = PIL.Image.fromarray(np.moveaxis(SCENE[:3], 0, -1).astype(np.uint8))
    options = {"sizes": [picture.size]} if format == "ICO" else {}
    try:
        picture.save(tmp_path / "a", format, **options)
    except (KeyError, OSError):
        pytest.skip("this Pillow does not write it")
    assert likeness(read_image(tmp_path / "a"), 3) > 0.9
    found = open_source(tmp_path / "a")
    assert isinstance(found, InMemoryPhoto)
    assert image_size(tmp_path / "a") == (96, 72)


def test_bands_of_what_gdal_does_not_know_are_refused(tmp_path):
    PIL.Image.fromarray(np.moveaxis(SCENE[:3], 0, -1).astype(np.uint8)).save(tmp_path / "a.ico")
    with pytest.raises(InputError, match="bands are chosen from rasters"):
        read_image(tmp_path / "a.ico", config=RasterConfig(bands=(1,)))
    with pytest.raises(ConfigError, match="2 bands"):
        read_image(write(tmp_path / "a.tif", scene("uint16", 2)), config=RasterConfig(bands=(3,)))


@pytest.mark.parametrize("dtype", ["int8", "uint8", "uint16", "int32", "uint32", "float32"])
def test_without_rasterio_one_band_is_read_by_the_same_rules(tmp_path, monkeypatch, dtype):
    values = np.maximum(scene(dtype, 1) + np.array(400 if dtype == "int32" else 0, dtype), 5)
    values[:, GAP] = 3
    declared, filled = write(tmp_path / "a.tif", values, nodata=3), write(tmp_path / "b.tif", values)
    expected = [read_image(path) for path in (declared, filled)]
    assert np.array_equal(expected[0].valid, ~GAP)
    monkeypatch.setattr(source, "open_raster", missing)
    for path, other in zip((declared, filled), expected, strict=True):
        image = read_image(path)
        assert np.array_equal(image.rgb, other.rgb)
        assert image.notes == other.notes
        assert (image.valid is None) == (other.valid is None)
        assert image.valid is None or np.array_equal(image.valid, other.valid)


def test_without_rasterio_a_raster_names_the_extra(tmp_path, monkeypatch):
    path = write(tmp_path / "a.tif", scene("uint16", 5))
    monkeypatch.setattr(source, "open_raster", missing)
    with pytest.raises(InputError, match=r"zpm2\[geo\]"):
        read_image(path, "left image")


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("format", ["TIFF", "JPEG", "PNG"])
def test_the_size_in_the_header_is_that_of_the_stored_pixels(tmp_path, orientation, format):
    exif = PIL.Image.Exif()
    exif[274] = orientation
    PIL.Image.fromarray(np.zeros((40, 60, 3), np.uint8)).save(tmp_path / "a", format, exif=exif)
    image = read_image(tmp_path / "a")
    assert image_size(tmp_path / "a") == (image.width, image.height) == (60, 40)


@pytest.mark.parametrize("format", ["GIF", "WEBP", "PNG"])
def test_of_moving_pictures_the_first_is_used(tmp_path, format):
    pages = [PIL.Image.fromarray(np.moveaxis(SCENE[k : k + 3], 0, -1).astype(np.uint8)) for k in (0, 2)]
    pages[0].save(tmp_path / "a", format, save_all=True, append_images=pages[1:])
    image = read_image(tmp_path / "a")
    assert any("first of 2 pictures" in note for note in image.notes)
    assert likeness(image, 3) > 0.8
