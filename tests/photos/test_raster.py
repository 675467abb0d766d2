import logging
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from zpm2.config import StretchConfig
from zpm2.errors import ConfigError, InputError, MissingDependency
from zpm2.formats import read_image
from zpm2.photos import raster
from zpm2.photos.raster import open_raster

rasterio = pytest.importorskip("rasterio")
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
from rasterio import shutil  # noqa: E402
from rasterio.control import GroundControlPoint  # noqa: E402
from rasterio.enums import ColorInterp, MaskFlags  # noqa: E402
from rasterio.rpc import RPC  # noqa: E402
from rasterio.transform import Affine  # noqa: E402
from rasterio.windows import Window  # noqa: E402
from rasters import write  # noqa: E402

RNG = np.random.default_rng(0)
BLOCKS = RNG.integers(0, 256, (3, 15, 20), np.uint8)
RGB = np.kron(BLOCKS, np.ones((1, 8, 8), np.uint8))  # (3, 120, 160) in squares of 8 px
DEEP = (RGB[:1].astype(np.uint16) + 300) * 7
UTM = Affine(0.5, 0, 500_000, 0, -0.5, 5_300_000)
SITE = 'LOCAL_CS["site",UNIT["metre",1]]'
SATELLITE = Path(__file__).resolve().parents[3] / "shared" / "data" / "satellite" / "s2p" / "input_pair"


def pixels(values):
    """(h, w, 3) of (bands, h, w)."""
    return np.repeat(values, 3 // len(values), axis=0).transpose(1, 2, 0)


def read(path, window=None, size=None, **options):
    with open_raster(path, **options) as opened:
        return opened.read(window, size)


def rational(**changes):
    """RPCs that are an affine map: 0.5 m a px at the equator near 30 degrees east, north up."""
    unit, east, north = [1.0] + [0.0] * 19, [0.0, 1.0] + [0.0] * 18, [0.0, 0.0, -1.0] + [0.0] * 17
    # over 60 px: 30 m, which is about 2.7e-4 degrees
    offsets = {"line_off": 60.0, "samp_off": 80.0, "line_scale": 60.0, "samp_scale": 60.0}
    ground = {"lat_off": 0.0, "long_off": 30.0, "height_off": 200.0, "height_scale": 500.0}
    scales = {"lat_scale": 30 / 110_574.3, "long_scale": 30 / 111_319.5}
    polynomials = {
        "line_num_coeff": north,
        "line_den_coeff": unit,
        "samp_num_coeff": east,
        "samp_den_coeff": unit,
    }
    return RPC(**{**offsets, **ground, **scales, **polynomials, **changes})


def test_8_bit_colour_is_what_read_image_gives(tmp_path):
    path = write(tmp_path / "a.tif", RGB, photometric="RGB")
    with open_raster(path) as opened:
        assert (opened.width, opened.height, opened.path, opened.notes) == (160, 120, str(path), ())
        image = opened.read()
        part = opened.read((10, 20, 110, 90))
    expected = read_image(path)
    assert np.array_equal(image.rgb, expected.rgb)
    assert (image.notes, image.path, image.valid) == (expected.notes, str(path), None)
    assert np.array_equal(part.rgb, expected.rgb[20:90, 10:110])


def test_reduced_pixels_are_averages(tmp_path):
    values = RNG.integers(0, 256, (3, 120, 160), np.uint8)
    path = write(tmp_path / "a.tif", values, photometric="RGB")
    means = values[:, 8:104, 16:144].reshape(3, 24, 4, 32, 4).mean((2, 4)).transpose(1, 2, 0)
    assert np.abs(read(path, (16, 8, 144, 104), (32, 24)).rgb - means).max() <= 0.51
    assert read(path, None, (50, 33)).rgb.shape == (33, 50, 3)


@pytest.mark.parametrize("size", [(161, 120), (160, 121), (0, 4)])
def test_windows_and_sizes_must_fit(tmp_path, size):
    path = write(tmp_path / "a.tif", RGB, photometric="RGB")
    with open_raster(path) as opened:
        with pytest.raises(AssertionError):
            opened.read(None, size)
        with pytest.raises(AssertionError):
            opened.read((0, 0, 161, 20))


@pytest.mark.parametrize("dtype", ["uint16", "int16", "uint32", "int32", "float32", "float64"])
def test_deep_values_share_one_range(tmp_path, dtype):
    path = write(tmp_path / "a.tif", DEEP.astype(dtype))
    expected = read_image(DEEP[0].astype(dtype))
    with open_raster(path) as opened:
        assert opened.notes == expected.notes
        assert "stretched" in opened.notes[0]
        assert np.array_equal(opened.read().rgb, expected.rgb)
        for window in ((0, 0, 40, 40), (100, 50, 160, 120)):
            x0, y0, x1, y1 = window
            assert np.array_equal(opened.read(window).rgb, expected.rgb[y0:y1, x0:x1])
        reduced = opened.read(None, (20, 15)).rgb
    assert np.array_equal(reduced, expected.rgb[4::8, 4::8])


def test_work_in_strips_changes_nothing(tmp_path, monkeypatch):
    values = RNG.normal(100, 20, (1, 120, 160)).astype(np.float32)
    values[0, 30:50, 30:50] = np.nan
    for path in (write(tmp_path / "a.tif", values), write(tmp_path / "b.tif", DEEP)):
        with open_raster(path) as opened:
            for size in ((160, 120), (47, 31), (40, 30)):
                whole = opened.read(None, size)
                with monkeypatch.context() as patch:
                    patch.setattr(raster, "CHUNK_BYTES", 3 * 4 * 4 * 160)
                    parts = opened.read(None, size)
                assert np.array_equal(whole.rgb, parts.rgb)
                assert np.array_equal(whole.valid, parts.valid)


def test_brightness_is_read_as_it_is(tmp_path):
    for values in ((RGB / 255).astype(np.float32), RGB.astype(np.float64), RGB.astype(np.uint16)):
        image = read(write(tmp_path / "a.tif", values, photometric="RGB"))
        assert np.array_equal(image.rgb, pixels(RGB))
        assert "brightness" in image.notes[0]


def test_the_range_comes_from_a_reduced_look(tmp_path):
    stretch = StretchConfig(sample_px=300)
    path = write(tmp_path / "a.tif", DEEP)
    assert "stretched" in read(path).notes[0]
    with open_raster(path, stretch=stretch) as opened:
        assert len(np.unique(opened.read().rgb)) > 100


def test_not_a_number(tmp_path):
    values = (DEEP + 0.5).astype(np.float32)
    values[0, 8:16, 8:20] = np.nan
    values[0, 40, 40] = np.inf
    path = write(tmp_path / "a.tif", values)
    with open_raster(path) as opened:
        assert any("without data" in note for note in opened.notes)
        assert any("stretched" in note for note in opened.notes)
        whole, reduced, rest = opened.read(), opened.read(None, (20, 15)), opened.read((48, 48, 160, 120))
    assert np.array_equal(whole.valid, np.isfinite(values[0]))
    assert not whole.rgb[~whole.valid].any()
    assert rest.valid is None
    # squares of 8 px: one is empty, one is half, one lacks a pixel
    assert reduced.valid.sum() == 20 * 15 - 1
    assert not reduced.valid[1, 1]
    full = whole.rgb[4::8, 4::8]
    full[5, 5] = whole.rgb[41, 41]
    full[1, 2] = whole.rgb[9, 23]
    assert np.array_equal(reduced.rgb[reduced.valid], full[reduced.valid])


@pytest.mark.parametrize("kind", ["nodata", "nan", "alpha", "mask", "deep alpha", "wide alpha"])
def test_what_has_no_data_is_left_out_of_averages(tmp_path, kind):
    gap = np.zeros((120, 160), bool)
    gap[:, :45] = True
    gap[3::8, 80] = True
    path = tmp_path / "a.tif"
    dtype = {"nan": np.float32, "deep alpha": np.uint16, "wide alpha": np.uint16}.get(kind, np.uint8)
    values = np.full((3, 120, 160), 200, dtype)
    values[:, gap] = 7
    colors = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
    if kind == "nodata":
        write(path, values, nodata=7, photometric="RGB")
    elif kind == "nan":
        write(path, np.where(gap, np.float32(np.nan), values), nodata=np.nan, photometric="RGB")
    elif kind == "mask":
        write(path, values, mask=~gap, photometric="RGB")
    else:
        opaque = {"alpha": 255, "deep alpha": 255, "wide alpha": 65535}[kind]
        write(path, np.concatenate([values, np.where(gap, 0, opaque).astype(dtype)[None]]), colors=colors, alpha="YES")
        with rasterio.open(path) as file:
            assert MaskFlags.alpha in file.mask_flag_enums[0]
    with open_raster(path) as opened:
        assert any("without data" in note for note in opened.notes)
        whole = opened.read()
        assert np.array_equal(whole.valid, ~gap)
        assert not whole.rgb[gap].any()
        assert (whole.rgb[~gap] == 200).all()
        for size in ((20, 15), (40, 30), (61, 47)):
            reduced = opened.read(None, size)
            edge = 45 * size[0] / 160
            assert not reduced.valid[:, : int(edge - 1)].any()
            assert reduced.valid[:, int(edge + 2) :].all()
            assert (reduced.rgb[reduced.valid] == 200).all()
            assert not reduced.rgb[~reduced.valid].any()
        assert opened.read((90, 0, 160, 120)).valid is None


def test_opaque_alpha_and_unused_nodata_say_nothing(tmp_path):
    rgba = np.concatenate([RGB, np.full((1, 120, 160), 255, np.uint8)])
    for path in (
        write(tmp_path / "a.png", rgba, driver="PNG"),
        write(tmp_path / "b.tif", np.maximum(RGB, 1), nodata=0, photometric="RGB"),
    ):
        image = read(path)
        assert (image.valid, image.notes) == (None, ())


def test_only_all_bands_without_data_make_a_gap(tmp_path):
    values = np.full((3, 40, 50), 9, np.uint8)
    values[0, :10] = 0
    values[:, 30:] = 0
    image = read(write(tmp_path / "a.tif", values, nodata=0, photometric="RGB"))
    assert np.array_equal(image.valid, np.arange(40)[:, None].repeat(50, 1) < 30)


def test_nothing_but_nodata_is_refused(tmp_path):
    for path in (
        write(tmp_path / "a.tif", np.zeros((3, 40, 50), np.uint8), nodata=0, photometric="RGB"),
        write(tmp_path / "b.tif", np.full((1, 40, 50), np.nan, np.float32)),
    ):
        with pytest.raises(InputError, match=r"left image .* has no pixel with data"):
            open_raster(path, "left image")


def test_palette(tmp_path):
    palette = {i: ((i * 37) % 256, (i * 91) % 256, 255 - i, 255) for i in range(256)}
    index = RGB[:1]
    path = write(tmp_path / "a.tif", index, palette=palette, photometric="palette")
    expected = np.array([palette[i][:3] for i in range(256)], np.uint8)[index[0]]
    with open_raster(path) as opened:
        assert opened.notes == ("The colour palette was expanded to RGB.",)
        assert np.array_equal(opened.read().rgb, expected)
        assert np.array_equal(opened.read(None, (20, 15)).rgb, expected[::8, ::8])
        halves = opened.read((0, 0, 160, 120), (10, 120)).rgb
    means = expected.reshape(120, 10, 2, 8, 3).mean((2, 3))
    assert np.abs(halves - means).max() <= 0.51


def test_palette_png_with_a_transparent_entry(tmp_path):
    picture = PIL.Image.fromarray(pixels(RGB)).quantize(16)
    picture.save(tmp_path / "a.png", transparency=3)
    image = read(tmp_path / "a.png")
    assert np.array_equal(image.valid, np.asarray(picture) != 3)
    assert np.array_equal(image.rgb[image.valid], np.asarray(picture.convert("RGB"))[image.valid])


@pytest.mark.parametrize("kind", ["png", "tif"])
def test_one_bit(tmp_path, kind):
    black_white = PIL.Image.fromarray(RGB[0]).convert("1")
    black_white.save(tmp_path / f"a.{kind}")
    image = read(tmp_path / f"a.{kind}")
    assert np.array_equal(image.rgb, read_image(tmp_path / f"a.{kind}").rgb)
    assert image.notes == ("1-bit values became black and white.",)
    reduced = read(tmp_path / f"a.{kind}", None, (20, 15)).rgb
    assert len(np.unique(reduced)) > 2


def test_default_bands(tmp_path):
    four = np.concatenate([RGB, RGB[:1] // 2])
    undefined = (ColorInterp.gray, *[ColorInterp.undefined] * 3)
    bgr = (ColorInterp.blue, ColorInterp.green, ColorInterp.red, ColorInterp.undefined)
    image = read(write(tmp_path / "a.tif", four, colors=undefined, photometric="MINISBLACK"))
    assert image.notes == ("Bands 1, 2 and 3 of 4 are used as red, green and blue; choose with --bands.",)
    assert np.array_equal(image.rgb, pixels(RGB))
    image = read(write(tmp_path / "b.tif", four, colors=bgr, photometric="MINISBLACK"))
    assert image.notes == ()
    assert np.array_equal(image.rgb, pixels(RGB[::-1]))
    image = read(write(tmp_path / "c.tif", four[:2], colors=undefined[:2], photometric="MINISBLACK"))
    assert image.notes == ("Band 1 of 2 is used as grey; choose with --bands.",)
    assert np.array_equal(image.rgb, pixels(RGB[:1]))
    gray_alpha = np.stack([RGB[0], np.full((120, 160), 255, np.uint8)])
    image = read(write(tmp_path / "d.png", gray_alpha, driver="PNG"))
    assert image.notes == ()
    assert np.array_equal(image.rgb, pixels(RGB[:1]))


def test_chosen_bands(tmp_path):
    path = write(tmp_path / "a.tif", np.concatenate([RGB, RGB[:1] // 2]), photometric="MINISBLACK")
    assert np.array_equal(read(path, bands=(4,)).rgb, pixels(RGB[:1] // 2))
    assert np.array_equal(read(path, bands=[3, 1, 2]).rgb, pixels(RGB[[2, 0, 1]]))
    assert read(path, bands=(3, 1, 2)).notes == ()
    for bands in ((1, 2), (0,), (5,), (1, 2, -1), (1, 2, 3, 4)):
        with pytest.raises(ConfigError, match="has 4 bands: give one"):
            open_raster(path, bands=bands)
    with pytest.raises(ConfigError, match="has 1 band: give one"):
        open_raster(write(tmp_path / "b.tif", DEEP), bands=(2,))


@pytest.mark.parametrize("quality", [75, 95])
def test_jpeg_and_cmyk(tmp_path, quality):
    picture = PIL.Image.fromarray(pixels(RGB))
    picture.save(tmp_path / "a.jpg", quality=quality, subsampling=0)
    assert np.abs(read(tmp_path / "a.jpg").rgb.astype(int) - read_image(tmp_path / "a.jpg").rgb).max() <= 2
    assert read(tmp_path / "a.jpg", None, (80, 60)).rgb.shape == (60, 80, 3)
    for name in ("b.jpg", "b.tif"):
        picture.convert("CMYK").save(tmp_path / name)
        image = read(tmp_path / name)
        assert "converted from CMYK" in image.notes[0]
        assert np.abs(image.rgb.astype(int) - pixels(RGB)).mean() < 12


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_exif_orientation_is_reported_and_not_applied(tmp_path, kind):
    exif = PIL.Image.Exif()
    exif[274] = 6
    path = tmp_path / "picture"
    PIL.Image.fromarray(pixels(RGB)).save(path, kind, exif=exif)
    image = read(path)
    assert image.notes == read_image(path).notes
    assert "orientation (6)" in image.notes[0]
    assert np.abs(image.rgb.astype(int) - pixels(RGB)).mean() < 12


def test_only_the_first_page_is_used(tmp_path):
    pages = [PIL.Image.fromarray(pixels(RGB)), PIL.Image.fromarray(255 - pixels(RGB))]
    path = tmp_path / "pages.tif"
    pages[0].save(path, save_all=True, append_images=pages[1:])
    image = read(path)
    assert image.notes == ("Only the first of 2 pictures in the file is used.",)
    assert np.array_equal(image.rgb, pixels(RGB))
    second = read(f"GTIFF_DIR:2:{path}")
    assert np.array_equal(second.rgb, 255 - pixels(RGB))


def test_a_format_that_is_not_listed_is_refused(tmp_path):
    source = write(tmp_path / "a.tif", RGB, crs="EPSG:32632", transform=UTM, photometric="RGB")
    for name, driver in (("a.gpkg", "GPKG"), ("a.img", "HFA"), ("a.ntf", "NITF"), ("a.bin", "ENVI")):
        shutil.copy(source, tmp_path / name, driver=driver)
        with pytest.raises(InputError, match=r"not a picture in a known format"):
            open_raster(tmp_path / name)


def test_tiles_and_overviews(tmp_path):
    values = np.kron(BLOCKS, np.ones((1, 40, 40), np.uint8))
    tiles = {"tiled": True, "blockxsize": 128, "blockysize": 128}
    path = write(tmp_path / "a.tif", values, overviews=(2, 4, 8), photometric="RGB", compress="deflate", **tiles)
    expected = pixels(BLOCKS).repeat(5, 0).repeat(5, 1)
    assert np.array_equal(read(path, None, (100, 75)).rgb, expected)
    with_nodata = write(tmp_path / "b.tif", np.maximum(values, 1), overviews=(2, 4, 8), nodata=0, **tiles)
    assert np.array_equal(read(with_nodata, None, (100, 75)).rgb, np.maximum(expected, 1))
    cog = write(tmp_path / "c.tif", values, driver="COG", blocksize=128, overview_resampling="average")
    assert np.array_equal(read(cog, (0, 0, 400, 200), (50, 25)).rgb, expected[:25, :50])


def test_jpeg_2000(tmp_path):
    if "JP2OpenJPEG" not in rasterio.drivers.raster_driver_extensions().values():
        pytest.skip("this GDAL has no JPEG 2000")
    options = {"driver": "JP2OpenJPEG", "quality": "100", "reversible": "YES"}
    assert np.array_equal(read(write(tmp_path / "a.jp2", RGB, **options)).rgb, pixels(RGB))
    path = write(tmp_path / "b.jp2", DEEP, **options)
    assert np.array_equal(read(path, (8, 16, 90, 70)).rgb, read_image(DEEP[0]).rgb[16:70, 8:90])


def test_vrt(tmp_path):
    shutil.copy(write(tmp_path / "a.tif", RGB, photometric="RGB"), tmp_path / "a.vrt", driver="VRT")
    assert np.array_equal(read(tmp_path / "a.vrt").rgb, pixels(RGB))
    (tmp_path / "a.tif").unlink()
    with (
        pytest.raises(InputError, match=r"left image .*a\.vrt .*damaged"),
        open_raster(tmp_path / "a.vrt", "left image") as r,
    ):
        r.read()


@pytest.mark.parametrize("turn", [0, 37, 180, -90])
@pytest.mark.parametrize("flip", [1, -1])
def test_ground_sampling_distance_of_a_projected_image(tmp_path, turn, flip):
    transform = UTM @ Affine.rotation(turn) @ Affine.scale(1, flip)
    path = write(tmp_path / "a.tif", RGB, crs="EPSG:32632", transform=transform, photometric="RGB")
    with open_raster(path) as opened:
        assert opened.geo.crs == "EPSG:32632"
        assert np.allclose(opened.geo.transform.ravel(), transform[:6], rtol=0, atol=1e-9)
        assert opened.geo.gsd == pytest.approx(0.5 / 0.9996, rel=1e-4)  # on the central meridian
        assert opened.placed
        points = RNG.uniform(-20, 180, (50, 2))
        degrees = opened.to_lon_lat(points)
        assert np.abs(degrees - (9.0, 47.85)).max() < 0.01
        assert np.abs(opened.from_lon_lat(degrees) - points).max() < 1e-4


@pytest.mark.parametrize(
    ("crs", "transform", "gsd"),
    [
        ("EPSG:4326", Affine(1e-5, 0, 8, 0, -1e-5, 60), np.sqrt(0.5578 * 1.1141)),
        ("EPSG:4326", Affine(1e-5, 0, 179.9995, 0, -1e-5, 0), np.sqrt(1.1132 * 1.1057)),
        ("EPSG:4326", Affine(1e-5, 0, 190, 0, -1e-5, 0), np.sqrt(1.1132 * 1.1057)),
        ("EPSG:3857", Affine(1, 0, 0, 0, -1, 8399737.9), 0.5014),  # 60 degrees north
        ("EPSG:2263", Affine(1, 0, 985_000, 0, -1, 200_000), 0.3048),  # in feet
        ("EPSG:3413", Affine(10, 0, -800, 0, -10, 600), 10 / 0.9699),  # the pole in the middle
        ("EPSG:4326", Affine(1, 0, -80, 0, -1, 60), 111_000),
    ],
)
def test_ground_sampling_distance_of_any_reference_system(tmp_path, crs, transform, gsd):
    path = write(tmp_path / "a.tif", RGB, crs=crs, transform=transform, photometric="RGB")
    with open_raster(path) as opened:
        assert opened.geo.gsd == pytest.approx(gsd, rel=5e-3)
        points = np.array([(3.0, 4.0), (80, 60), (150, 110)])
        degrees = opened.to_lon_lat(points)
        assert (np.abs(degrees) <= (180, 90)).all()
        assert np.abs(opened.from_lon_lat(degrees) - points).max() < 1e-3
    with open_raster(path, gsd=0.25) as opened:
        assert opened.geo.gsd == 0.25


@pytest.mark.parametrize(("west", "each"), [(-180, 360 / 159), (0, 360 / 160), (-180.5, 361 / 160)])
def test_borders_of_a_world_map_stay_apart(tmp_path, west, each):
    path = write(tmp_path / "a.tif", RGB, crs="EPSG:4326", transform=Affine(each, 0, west, 0, -1, 60))
    with open_raster(path) as opened:
        borders = np.array([(0, 5.0), (360 / each, 5), (160, 5)])
        assert np.allclose(opened.from_lon_lat(opened.geo.to_world(borders)), borders)


def test_reference_systems_without_a_code(tmp_path):
    laea = "+proj=laea +lat_0=47.3 +lon_0=8.1 +ellps=WGS84 +units=m"
    path = write(tmp_path / "a.tif", RGB, crs=laea, transform=Affine(2, 0, 0, 0, -2, 0), photometric="RGB")
    with open_raster(path) as opened:
        assert "PROJC" in opened.geo.crs
        assert opened.geo.gsd == pytest.approx(2, rel=1e-3)
        assert opened.to_lon_lat(np.zeros((1, 2))) == pytest.approx(np.array([[8.1, 47.3]]))
    path = write(tmp_path / "b.tif", RGB, crs=SITE, transform=Affine(2, 0, 0, 0, -2, 0), photometric="RGB")
    with open_raster(path) as opened:
        assert "site" in opened.geo.crs
        assert opened.geo.located
        assert not opened.placed
        assert opened.geo.gsd is None
        assert np.isnan(opened.to_lon_lat(np.zeros((2, 2)))).all()


def test_no_georeference(tmp_path):
    path = write(tmp_path / "a.tif", RGB, photometric="RGB")
    with open_raster(path) as opened:
        assert (opened.geo.crs, opened.geo.transform, opened.geo.gsd) == (None, None, None)
        assert not opened.placed
        assert np.isnan(opened.to_lon_lat(np.zeros((2, 2)))).all()
        assert np.isnan(opened.from_lon_lat(np.zeros((2, 2)))).all()
    with open_raster(path, gsd=0.25) as opened:
        assert opened.geo.gsd == 0.25


def test_places_that_do_not_exist(tmp_path):
    path = write(tmp_path / "a.tif", RGB, crs="EPSG:32632", transform=UTM, photometric="RGB")
    with open_raster(path) as opened:
        degrees = np.array([(9, 47.85), (9, 95), (np.nan, 40), (np.inf, 3), (9.0001, 47.85)])
        back = opened.from_lon_lat(degrees)
        assert np.isfinite(back).all(axis=1).tolist() == [True, False, False, False, True]
        points = np.array([(1e30, 1), (3, 4), (np.nan, 1)])
        assert np.isfinite(opened.to_lon_lat(points)).all(axis=1).tolist() == [False, True, False]
        assert opened.to_lon_lat(np.zeros((0, 2))).shape == (0, 2)
        assert opened.from_lon_lat(np.zeros((0, 2))).shape == (0, 2)


def test_control_points_alone_do_not_place(tmp_path):
    corners = [(0, 0), (0, 160), (120, 0), (120, 160)]
    gcps = [GroundControlPoint(r, c, 9 + c * 1e-5, 47 - r * 1e-5) for r, c in corners]
    path = write(tmp_path / "a.tif", RGB, gcps=gcps, crs="EPSG:4326", photometric="RGB")
    with open_raster(path) as opened:
        assert not opened.placed
        assert opened.geo.transform is None
        assert any("ground control points are not used" in note for note in opened.notes)


def test_rational_polynomials(tmp_path):
    path = write(tmp_path / "a.tif", RGB, rpcs=rational(), photometric="RGB")
    with open_raster(path) as opened:
        assert opened.notes == ("Placed by its rational polynomial coefficients (RPC).",)
        assert opened.placed
        assert not opened.geo.located
        assert opened.geo.gsd == pytest.approx(0.5, rel=1e-4)
        # the polynomials speak of pixel centres: sample 80 is 80.5 px
        assert opened.to_lon_lat(np.array([[80.5, 60.5]])) == pytest.approx(np.array([[30.0, 0.0]]), abs=1e-9)
        points = RNG.uniform(0, 160, (50, 2)) * (1, 0.75)
        degrees = opened.to_lon_lat(points)
        assert np.abs(opened.from_lon_lat(degrees) - points).max() < 1e-3
        nowhere = opened.from_lon_lat(np.array([(-60.0, 10), (30.0, 0.5), (np.nan, 0), (390.0, 0.0)]))
        assert np.isfinite(nowhere).all(axis=1).tolist() == [False, False, False, True]
        assert np.isnan(opened.to_lon_lat(np.array([[1e6, 1e6]]))).all()
        assert opened.from_lon_lat(np.zeros((0, 2))).shape == (0, 2)


def test_rational_polynomials_at_the_date_line_and_beside_the_file(tmp_path):
    path = write(tmp_path / "a.tif", RGB, rpcs=rational(long_off=180.0), photometric="RGB")
    with open_raster(path) as opened:
        points = np.array([[10.0, 60], [150.0, 60]])
        degrees = opened.to_lon_lat(points)
        assert degrees[0, 0] > 179.99
        assert degrees[1, 0] < -179.99
        assert np.abs(opened.from_lon_lat(degrees) - points).max() < 1e-3
    path = write(tmp_path / "b.tif", RGB, photometric="RGB")
    lines = []
    for key, value in rational().to_gdal().items():
        numbers = value.split()
        names = [f"{key}_{i + 1}" for i in range(20)] if len(numbers) > 1 else [key]
        lines += [f"{name}: {number}" for name, number in zip(names, numbers, strict=True)]
    (tmp_path / "b_RPC.TXT").write_text("\n".join(lines))
    with open_raster(path) as opened:
        assert opened.placed
        assert opened.geo.gsd == pytest.approx(0.5, rel=1e-4)


def test_a_real_satellite_pair():
    if not SATELLITE.is_dir():
        pytest.skip("the satellite pair of s2p is not here")
    with open_raster(SATELLITE / "img_01.tif") as left, open_raster(SATELLITE / "img_02.tif") as right:
        assert left.placed
        assert 0.4 < left.geo.gsd < 0.8
        points = RNG.uniform(0, 1024, (200, 2))
        assert np.abs(left.from_lon_lat(left.to_lon_lat(points)) - points).max() < 1e-2
        across = right.from_lon_lat(left.to_lon_lat(np.array([[512.0, 512.0]])))
        assert np.abs(across - 512).max() < 700  # the terrain is higher than its mean
        assert 60 < left.read((300, 300, 500, 500)).rgb.mean() < 200


def test_file_problems_are_one_line_that_names_the_file(tmp_path, capfd):
    (tmp_path / "empty.tif").write_bytes(b"")
    (tmp_path / "text.tif").write_text("not a picture")
    (tmp_path / "folder.tif").mkdir()
    noise = RNG.integers(0, 256, (3, 300, 400), np.uint8)
    kinds = {"JPEG": "jpg", "PNG": "png", "GTiff": "tif", "JP2OpenJPEG": "jp2"}
    for driver, ending in kinds.items():
        data = write(tmp_path / f"whole.{ending}", noise, driver=driver).read_bytes()
        for share in (0.02, 0.3, 0.7, 0.97):
            (tmp_path / f"cut{share}.{ending}").write_bytes(data[: int(len(data) * share)])
        (tmp_path / f"whole.{ending}").unlink()
    write(tmp_path / "complex.tif", np.zeros((1, 40, 50), np.complex64))
    write(tmp_path / "small.tif", np.zeros((1, 31, 50), np.uint8))
    paths = [*sorted(tmp_path.iterdir()), tmp_path / "missing.tif", tmp_path / "empty.tif" / "below.tif"]
    paths += [Path("/vsicurl/http:/nowhere/a.tif"), "https://nowhere.invalid/a.tif", "COG:/vsicurl/http://a.tif"]
    assert len(paths) == 26
    for path in paths:
        with pytest.raises(InputError) as caught, open_raster(path, "left image") as opened:
            opened.read()
        message = str(caught.value)
        assert message.startswith(f"left image {path}"), message
        assert "\n" not in message
        assert "previous exception" not in message
    assert capfd.readouterr() == ("", "")


def test_an_undamaged_window_of_a_damaged_file_is_read(tmp_path):
    path = write(tmp_path / "a.tif", RGB, photometric="RGB", interleave="pixel", blockysize=8)
    path.write_bytes(path.read_bytes()[: 160 * 100 * 3])
    with open_raster(path) as opened:
        assert np.array_equal(opened.read((0, 0, 160, 80)).rgb, pixels(RGB)[:80])
        with pytest.raises(InputError, match="damaged or cut short"):
            opened.read((0, 80, 160, 120))


@pytest.mark.parametrize("kind", ["tif", "png", "jpg", "jp2", "vrt"])
def test_an_empty_overview_file_is_ignored(tmp_path, kind):
    driver = {"tif": "GTiff", "png": "PNG", "jpg": "JPEG", "jp2": "JP2OpenJPEG", "vrt": "VRT"}[kind]
    path = tmp_path / f"a.{kind}"
    shutil.copy(write(tmp_path / "source.tif", RGB, photometric="RGB"), path, driver=driver)
    plain, reduced = read(path), read(path, None, (40, 30))
    (tmp_path / f"a.{kind}.ovr").write_bytes(b"")
    image = read(path)
    assert image.notes == (f"The overview file a.{kind}.ovr is empty and was ignored.",)
    assert np.array_equal(image.rgb, plain.rgb)
    assert np.array_equal(read(path, None, (40, 30)).rgb, reduced.rgb)


def test_a_damaged_overview_file_is_named(tmp_path):
    noise = RNG.integers(0, 256, (1, 1200, 1600), np.uint8)
    path = write(tmp_path / "a.tif", noise)
    with rasterio.Env(TIFF_USE_OVR=True), rasterio.open(path, "r+") as file:
        file.build_overviews([2, 4])
    side = tmp_path / "a.tif.ovr"
    side.write_bytes(side.read_bytes()[:100_000])
    with open_raster(path) as opened:
        assert opened.read((0, 0, 50, 50)).valid is None
        with pytest.raises(InputError, match=r"a\.tif or its overview file a\.tif\.ovr is damaged"):
            opened.read(None, (400, 300))


def test_nothing_is_written_beside_the_input(tmp_path):
    write(tmp_path / "a.tif", DEEP, crs="EPSG:32632", transform=UTM, nodata=0)
    shutil.copy(tmp_path / "a.tif", tmp_path / "b.jp2", driver="JP2OpenJPEG")
    PIL.Image.fromarray(pixels(RGB)).save(tmp_path / "c.jpg")
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    for name in before:
        if Path(name).suffix != ".xml":
            read(tmp_path / name)
            read(tmp_path / name, None, (40, 30))
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_warnings_and_logs_stay_away(tmp_path, capfd):
    path = write(tmp_path / "a.tif", RGB, photometric="RGB")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(path, None, (40, 30))
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("rasterio").level == logging.NOTSET


GIANT = """
import resource, sys, time
from zpm2.photos.raster import open_raster
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
with open_raster(sys.argv[1]) as opened:
    assert (opened.width, opened.height) == (60000, 40000)
    assert opened.read((30000, 20000, 30500, 20400)).rgb.shape == (400, 500, 3)
    assert opened.read((0, 0, 20000, 10000), (500, 250)).rgb.max() == 0
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def test_a_giant_raster_takes_little_memory(tmp_path):
    options = {"driver": "GTiff", "width": 60_000, "height": 40_000, "count": 3, "dtype": "uint16", "tiled": True}
    with rasterio.open(tmp_path / "a.tif", "w", crs="EPSG:32632", transform=UTM, sparse_ok=True, **options) as file:
        block = np.full((3, 512, 512), 900, np.uint16)
        file.write(block, window=Window(30_208, 19_968, 512, 512))
    run = subprocess.run([sys.executable, "-c", GIANT, tmp_path / "a.tif"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) < 700 * 1024 * (1024 if sys.platform == "darwin" else 1)  # KiB, of 14 GiB of pixels


def test_rasterio_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(MissingDependency, match=r'needs rasterio: pip install "zpm2\[geo\]"'):
        open_raster("a.tif")


def test_closing(tmp_path):
    opened = open_raster(write(tmp_path / "a.tif", RGB, photometric="RGB"))
    opened.close()
    with pytest.raises(InputError):
        opened.read()
