"""The photographs of a run: order, duplicates, positions."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from zpm2.config import RasterConfig
from zpm2.errors import InputError
from zpm2.tracking.photographs import distances, read_photographs

RASTER = RasterConfig()


def save(path: Path, seed: int, position: tuple[float, float] | None = None, size: tuple[int, int] = (48, 36)) -> Path:
    path.parent.mkdir(exist_ok=True)
    picture = PIL.Image.fromarray(np.random.default_rng(seed).integers(0, 255, (*size[::-1], 3), np.uint8))
    exif = PIL.Image.Exif()
    if position is not None:
        lon, lat = position
        exif[0x8825] = {
            1: "S" if lat < 0 else "N",
            2: (int(abs(lat)), 0.0, abs(lat) % 1 * 3600),
            3: "W" if lon < 0 else "E",
            4: (int(abs(lon)), 0.0, abs(lon) % 1 * 3600),
        }
    picture.save(path, exif=exif)
    return path


def test_the_order_is_that_of_the_names(tmp_path: Path) -> None:
    paths = [save(tmp_path / f"p{k}.jpg", k, size=(48 + k, 36)) for k in (10, 2, 1)]
    for given in (paths, paths[::-1], [tmp_path]):
        found = read_photographs(given, RASTER)
        assert [each.name for each in found] == ["p1.jpg", "p2.jpg", "p10.jpg"]
        assert [each.width for each in found] == [49, 50, 58]
    assert distances(found) is None


def test_equal_names_in_two_folders(tmp_path: Path) -> None:
    paths = [save(tmp_path / folder / "a.jpg", k) for k, folder in enumerate(("two", "one"))]
    assert [each.name for each in read_photographs(paths, RASTER)] == ["one/a.jpg", "two/a.jpg"]


def test_positions_are_read(tmp_path: Path) -> None:
    places = [(-70.5, -33.25), (-70.5, -33.26), (-70.49, -33.25)]
    found = read_photographs([save(tmp_path / f"{k}.jpg", k, at) for k, at in enumerate(places)], RASTER)
    apart = distances(found)
    assert apart is not None
    assert found[0].position == pytest.approx(places[0], abs=1e-6)
    assert apart[0, 1] == pytest.approx(1112, abs=2)
    assert apart[0, 2] == pytest.approx(1112 * np.cos(np.radians(33.25)), abs=2)


def test_what_cannot_be_used(tmp_path: Path) -> None:
    a = save(tmp_path / "a.jpg", 0)
    with pytest.raises(InputError, match="1 photograph given"):
        read_photographs([a], RASTER)
    copy = tmp_path / "b.jpg"
    copy.write_bytes(a.read_bytes())
    with pytest.raises(InputError, match=r"b.jpg and .*a.jpg are the same photograph"):
        read_photographs([a, copy], RASTER)
    with pytest.raises(InputError, match="are the same photograph"):
        read_photographs([a, a], RASTER)
    copy.write_bytes(b"no photograph")
    with pytest.raises(InputError, match=r"b.jpg"):
        read_photographs([a, copy], RASTER)
