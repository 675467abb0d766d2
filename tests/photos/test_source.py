import numpy as np
import PIL.Image
import pytest

from zpm2.config import RasterConfig
from zpm2.errors import ConfigError, InputError, MissingDependency
from zpm2.model import Image
from zpm2.photos import source
from zpm2.photos.raster import Raster
from zpm2.photos.source import InMemoryPhoto, open_source, opened, reduced

RNG = np.random.default_rng(0)
PIXELS = RNG.integers(0, 256, (120, 160, 3), np.uint8)


def tif(path, pixels=PIXELS, placed=True, **options):
    rasterio = pytest.importorskip("rasterio")
    height, width, count = pixels.shape
    options = {"driver": "GTiff", "width": width, "height": height, "count": count, "dtype": "uint8", **options}
    if placed:
        options |= {"crs": "EPSG:32632", "transform": rasterio.transform.Affine(0.5, 0, 691_000, 0, -0.5, 5_300_000)}
    with rasterio.open(path, "w", **options) as file:
        file.write(np.moveaxis(pixels, 2, 0))
    return path


def png(path, pixels=PIXELS):
    PIL.Image.fromarray(pixels).save(path)
    return path


@pytest.fixture
def without_rasterio(monkeypatch):
    def missing(*_, **__):
        raise MissingDependency("rasterio is missing")

    monkeypatch.setattr(source, "open_raster", missing)


# --- in memory


@pytest.mark.parametrize("window", [None, (0, 0, 160, 120), (10, 20, 74, 84), (159, 119, 160, 120)])
def test_windows_of_what_is_in_memory(window):
    held = InMemoryPhoto(Image(PIXELS, "a.png", ("a note",)), ["another"], 0.5)
    image = held.read(window)
    x0, y0, x1, y1 = window or (0, 0, 160, 120)
    assert np.array_equal(image.rgb, PIXELS[y0:y1, x0:x1])
    assert (image.path, image.valid) == ("a.png", None)
    assert held.notes == ("a note", "another")
    assert (held.width, held.height, held.path, held.geo.gsd, held.placed) == (160, 120, "a.png", 0.5, False)


def test_reduced_windows_are_averages():
    held = InMemoryPhoto(Image(PIXELS))
    image = held.read((16, 8, 144, 104), (32, 24))
    means = PIXELS[8:104, 16:144].reshape(24, 4, 32, 4, 3).mean((1, 3))
    assert np.abs(image.rgb - means).max() <= 0.51
    assert held.read((16, 8, 144, 104), (50, 33)).rgb.shape == (33, 50, 3)
    one = held.read(None, (1, 1)).rgb
    assert np.abs(one - PIXELS.mean((0, 1))).max() < 1


def test_a_reduced_pixel_is_valid_where_half_of_it_is():
    valid = np.zeros((120, 160), bool)
    valid[:, 10:] = True
    held = InMemoryPhoto(Image(PIXELS, None, (), valid))
    assert np.array_equal(held.read().valid, valid)
    assert np.array_equal(held.read((4, 0, 20, 40)).valid, valid[:40, 4:20])
    reduced_ = held.read(None, (40, 30)).valid
    assert reduced_.shape == (30, 40)
    assert reduced_.dtype == bool
    assert not reduced_[:, :2].any()
    assert reduced_[:, 2:].all()  # of the third one half is valid
    assert held.read((40, 0, 80, 40), (10, 10)).valid.all()


def test_what_is_in_memory_lies_nowhere():
    held = InMemoryPhoto(Image(PIXELS))
    assert np.isnan(held.to_lon_lat(np.zeros((3, 2)))).all()
    assert held.from_lon_lat(np.zeros((3, 2))).shape == (3, 2)
    assert np.isnan(held.from_lon_lat(np.zeros((3, 2)))).all()
    assert not held.geo.located
    held.close()


def test_all_of_a_photograph_reduced():
    held = InMemoryPhoto(Image(PIXELS))
    assert reduced(held, 80).rgb.shape == (60, 80, 3)
    assert np.array_equal(reduced(held, 160).rgb, PIXELS)
    assert np.array_equal(reduced(held, 1000).rgb, PIXELS)
    long = InMemoryPhoto(Image(np.zeros((3, 900, 3), np.uint8)))
    assert reduced(long, 30).rgb.shape == (1, 30, 3)


# --- which it is


def test_pixels_are_held():
    for given in (PIXELS, PIL.Image.fromarray(PIXELS), Image(PIXELS)):
        found = open_source(given, gsd=0.2)
        assert isinstance(found, InMemoryPhoto)
        assert np.array_equal(found.read().rgb, PIXELS)
        assert (found.path, found.geo.gsd, found.notes) == (None, 0.2, ())


def test_a_small_file_is_held(tmp_path):
    for path in (png(tmp_path / "a.png"), str(tmp_path / "a.png")):
        found = open_source(path, gsd=0.2)
        assert isinstance(found, InMemoryPhoto)
        assert found.path == str(path)
        assert np.array_equal(found.read().rgb, PIXELS)
        assert found.geo.gsd == 0.2


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_a_tif_without_a_place_is_held(tmp_path):
    assert isinstance(open_source(tif(tmp_path / "a.tif", placed=False, photometric="RGB")), InMemoryPhoto)


def test_a_georeferenced_file_is_read_by_windows(tmp_path):
    found = open_source(tif(tmp_path / "a.tif", photometric="RGB"))
    assert isinstance(found, Raster)
    assert found.placed
    assert found.geo.crs == "EPSG:32632"
    assert np.array_equal(found.read((10, 20, 74, 84)).rgb, PIXELS[20:84, 10:74])
    found.close()
    own = open_source(tmp_path / "a.tif", gsd=3.0)
    assert own.geo.gsd == 3.0
    own.close()


def test_a_large_file_is_read_by_windows(tmp_path):
    pytest.importorskip("rasterio")
    path = png(tmp_path / "a.png")
    found = open_source(path, config=RasterConfig(large_px=160 * 120 - 1))
    assert isinstance(found, Raster)
    assert np.array_equal(found.read().rgb, PIXELS)
    found.close()
    assert isinstance(open_source(path, config=RasterConfig(large_px=160 * 120)), InMemoryPhoto)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_chosen_bands(tmp_path):
    path = tif(tmp_path / "a.tif", np.dstack([PIXELS, 255 - PIXELS[..., :1]]), placed=False)
    found = open_source(path, config=RasterConfig(bands=(4, 2, 1)))
    assert isinstance(found, Raster)
    assert np.array_equal(found.read().rgb, np.dstack([255 - PIXELS[..., 0], PIXELS[..., 1], PIXELS[..., 0]]))
    found.close()
    with pytest.raises(ConfigError, match="4 bands"):
        open_source(path, config=RasterConfig(bands=(5,)))


def test_bands_of_pixels_are_refused():
    for given in (PIXELS, Image(PIXELS), PIL.Image.fromarray(PIXELS)):
        with pytest.raises(InputError, match=r"left image.*bands"):
            open_source(given, "left image", RasterConfig(bands=(1, 2, 3)))


# --- what cannot be read


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.xyz"])
def test_a_missing_file(tmp_path, name):
    with pytest.raises(InputError, match=f"left image.*{name}"):
        open_source(tmp_path / name, "left image")


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.jpg", "a.xyz"])
def test_a_file_that_is_no_photograph(tmp_path, name):
    (tmp_path / name).write_bytes(b"this is no photograph" * 10)
    with pytest.raises(InputError, match=f"left image.*{name}"):
        open_source(tmp_path / name, "left image")
    with pytest.raises(InputError, match=f"left image.*{name}"):
        open_source(tmp_path / name, "left image", config=RasterConfig(bands=(1,)))


def test_pixels_that_are_no_photograph():
    with pytest.raises(InputError, match="right image"):
        open_source(np.zeros((5, 5, 7, 2)), "right image")


# --- without rasterio


@pytest.mark.usefixtures("without_rasterio")
def test_without_rasterio_files_are_held(tmp_path):
    found = open_source(png(tmp_path / "a.png"))
    assert isinstance(found, InMemoryPhoto)
    assert found.notes == ()


@pytest.mark.usefixtures("without_rasterio")
def test_without_rasterio_a_georeference_is_lost_and_a_note_says_so(tmp_path):
    path = tif(tmp_path / "a.tif", photometric="RGB")
    found = open_source(path)
    assert isinstance(found, InMemoryPhoto)
    assert not found.placed
    assert [note for note in found.notes if "georeference" in note and "zpm2[geo]" in note]
    assert np.array_equal(found.read().rgb, PIXELS)
    assert len(open_source(path, config=RasterConfig(large_px=1000)).notes) == len(found.notes) + 1


@pytest.mark.usefixtures("without_rasterio")
def test_without_rasterio_a_large_file_is_in_memory_and_a_note_says_so(tmp_path):
    found = open_source(png(tmp_path / "a.png"), config=RasterConfig(large_px=1000))
    assert isinstance(found, InMemoryPhoto)
    assert [note for note in found.notes if "memory" in note and "zpm2[geo]" in note]


@pytest.mark.usefixtures("without_rasterio")
def test_without_rasterio_bands_cannot_be_chosen(tmp_path):
    with pytest.raises(MissingDependency):
        open_source(png(tmp_path / "a.png"), config=RasterConfig(bands=(1,)))


# --- pairs


def test_a_pair_is_closed_at_the_end(tmp_path, monkeypatch):
    path = tif(tmp_path / "a.tif", photometric="RGB")
    closed = []
    monkeypatch.setattr(Raster, "close", lambda self: closed.append(self.path))
    with opened(path, PIXELS, RasterConfig(gsd=(0.3, 0.7))) as (left, right):
        assert isinstance(left, Raster)
        assert isinstance(right, InMemoryPhoto)
        assert (left.geo.gsd, right.geo.gsd) == (0.3, 0.7)
        assert closed == []
    assert closed == [str(path)]
    with opened(PIXELS, PIXELS, RasterConfig(gsd=(0.3,))) as (left, right):
        assert (left.geo.gsd, right.geo.gsd) == (0.3, 0.3)
    with opened(PIXELS, PIXELS) as (left, right):
        assert (left.geo.gsd, right.geo.gsd) == (None, None)


def test_the_left_one_is_closed_where_the_right_one_cannot_be_read(tmp_path, monkeypatch):
    path = tif(tmp_path / "a.tif", photometric="RGB")
    closed = []
    monkeypatch.setattr(Raster, "close", lambda self: closed.append(self.path))
    with pytest.raises(InputError, match="right image"), opened(path, tmp_path / "none.png"):
        pass
    assert str(path) in closed
