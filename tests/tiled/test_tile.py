import dataclasses
import errno
import gzip
import json
import os

import numpy as np
import PIL.Image
import pytest

from zpm2.config import Config
from zpm2.errors import Failed, OutputError
from zpm2.files import reading
from zpm2.model import Image, ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.photos.raster import open_raster
from zpm2.photos.source import InMemoryPhoto, open_source
from zpm2.result import MatchResult
from zpm2.tiled import tile as tiles
from zpm2.tiled.tile import Tile, TileCache
from zpm2.tiled.view import read_view, reduced_size

WINDOWS = (3, 5, 515, 517), (0, 7, 600, 500)


def ring(rng, n=5):
    return np.ascontiguousarray(rng.uniform(0, 500, (n, 2)))


def a_tile(windows=WINDOWS):
    rng = np.random.default_rng(0)
    left = [Polygon(0, ring(rng), (ring(rng, 3), ring(rng, 4)), 1 / 3, None, "roof"), Polygon(1, ring(rng, 9))]
    right = [Polygon(0, ring(rng), (), 0.1)]
    points = PointMatches(rng.normal(0, 1e3, (40, 2)), rng.normal(0, 1e3, (40, 2)), rng.random(40))
    return Tile(2, windows, (left, right), np.array([[1, 0]]), points, {"detect": 1.25, "points": 0.1})


def same(a, b):
    assert (a.level, a.windows, dict(a.seconds)) == (b.level, b.windows, dict(b.seconds))
    assert np.array_equal(a.guided, b.guided)
    for name in ("left", "right", "score"):
        assert np.array_equal(getattr(a.points, name), getattr(b.points, name))
    for own, other in zip(a.polygons, b.polygons, strict=True):
        for p, q in zip(own, other, strict=True):
            assert (p.id, p.score, p.label, p.parent) == (q.id, q.score, q.label, q.parent)
            rings = zip((p.exterior, *p.holes), (q.exterior, *q.holes), strict=True)
            assert all(np.array_equal(one, two) for one, two in rings)


# --- files


@pytest.mark.parametrize("windows", [WINDOWS, (WINDOWS[0], None), (None, WINDOWS[1])])
def test_a_tile_comes_back_as_it_was(tmp_path, windows):
    kept = TileCache(tmp_path, "abc")
    kept.save("2-7", a_tile(windows))
    assert kept.reused == 0
    again = TileCache(tmp_path, "abc")
    same(again.load("2-7", windows), a_tile(windows))
    assert again.reused == 1
    assert [path.name for path in (tmp_path / "abc").iterdir()] == ["2-7.json.gz"]


def test_a_large_tile_comes_back(tmp_path, monkeypatch):
    """Its file is as long as what it holds asks for, which no bomb's is."""
    monkeypatch.setattr(reading, "MAX_UNPACKED_BYTES", 1000)
    rng = np.random.default_rng(0)
    points = PointMatches(rng.uniform(0, 500, (1000, 2)), rng.uniform(0, 500, (1000, 2)), rng.uniform(0, 1, 1000))
    kept = TileCache(tmp_path, "abc")
    kept.save("0-0", dataclasses.replace(a_tile(), points=points))
    again = kept.load("0-0", WINDOWS)
    assert again is not None
    assert np.array_equal(again.points.left, points.left)


def test_an_empty_tile_comes_back(tmp_path):
    empty = Tile(0, WINDOWS, ([], []), np.zeros((0, 2), np.int64), PointMatches.empty(), {})
    kept = TileCache(tmp_path, "abc")
    kept.save("0-0", empty)
    again = kept.load("0-0", WINDOWS)
    same(again, empty)
    assert again.guided.shape == (0, 2)
    assert again.points.left.shape == (0, 2)


def test_the_same_tile_is_the_same_file(tmp_path):
    for folder in "ab":
        TileCache(tmp_path, folder).save("0-0", a_tile())
    assert (tmp_path / "a" / "0-0.json.gz").read_bytes() == (tmp_path / "b" / "0-0.json.gz").read_bytes()


def test_a_tile_of_another_window_or_name_or_run_is_not_loaded(tmp_path):
    kept = TileCache(tmp_path, "abc")
    kept.save("2-7", a_tile())
    assert kept.load("2-7", (WINDOWS[0], None)) is None
    assert kept.load("2-7", ((3, 5, 515, 518), WINDOWS[1])) is None
    assert kept.load("2-8", WINDOWS) is None
    assert TileCache(tmp_path, "other").load("2-7", WINDOWS) is None
    assert kept.reused == 0


def document():
    return tiles._to_dict(a_tile())


def without(name):
    return {key: value for key, value in document().items() if key != name}


FOREIGN = [
    b"",
    b"no gzip",
    gzip.compress(b""),
    gzip.compress(b"no json"),
    gzip.compress(b"\xff\xfe\x00"),
    *(
        gzip.compress(json.dumps(content).encode())
        for content in (
            {},
            [],
            7,
            None,
            "text",
            *(without(name) for name in document()),
            {**document(), "sides": []},
            {**document(), "sides": document()["sides"][:1]},
            {**document(), "sides": [None, None]},
            {**document(), "seconds": []},
            {**document(), "guided": [[1, 2, 3]]},
            {**document(), "level": "two"},
            {**document(), "points": {"left": [[0, 0]], "right": [], "score": "x"}},
        )
    ),
]


@pytest.mark.parametrize("data", FOREIGN, ids=range(len(FOREIGN)))
def test_a_foreign_file_is_not_loaded(tmp_path, data):
    kept = TileCache(tmp_path, "abc")
    (tmp_path / "abc").mkdir()
    (tmp_path / "abc" / "2-7.json.gz").write_bytes(data)
    assert kept.load("2-7", WINDOWS) is None
    assert kept.reused == 0


@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_a_file_that_was_cut_short_or_damaged_is_not_loaded(tmp_path, share):
    kept = TileCache(tmp_path, "abc")
    kept.save("2-7", a_tile())
    path = tmp_path / "abc" / "2-7.json.gz"
    data = path.read_bytes()
    at = int(share * len(data))
    path.write_bytes(data[:at])
    assert kept.load("2-7", WINDOWS) is None
    path.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
    assert kept.load("2-7", WINDOWS) is None
    path.write_bytes(data)
    assert kept.load("2-7", WINDOWS) is not None


def test_without_a_folder_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kept = TileCache(None, "")
    kept.save("2-7", a_tile())
    assert kept.load("2-7", WINDOWS) is None
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk(tmp_path, monkeypatch):
    kept = TileCache(tmp_path, "abc")
    kept.save("2-7", a_tile())

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(OutputError, match=r"2-8\.json\.gz.*disk is full.*finished tiles are kept.*run.*again"):
            kept.save("2-8", a_tile())
    assert kept.load("2-7", WINDOWS) is not None
    assert kept.load("2-8", WINDOWS) is None
    assert len(list((tmp_path / "abc").iterdir())) == 1


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match="taken"):
        TileCache(tmp_path / "taken", "abc").save("2-7", a_tile())


# --- keys


def photograph(path, seed=0):
    pixels = np.random.default_rng(seed).integers(0, 255, (60, 80, 3), np.uint8)
    PIL.Image.fromarray(pixels).save(path)
    return path


def test_the_key_says_what_would_give_the_same_tiles(tmp_path, monkeypatch):
    paths = [photograph(tmp_path / f"{name}.png", seed) for seed, name in enumerate("ab")]
    config = Config().to_dict()

    def key(paths=paths, config=config, segmenters="sam/sam"):
        return tiles.key([open_source(path) for path in paths], config, segmenters)

    first = key()
    assert first == key()
    assert len({first, key(paths[::-1]), key([paths[0]] * 2), key(segmenters="sam/other")}) == 4
    changed = dataclasses.replace(Config(), tiles=dataclasses.replace(Config().tiles, size=512)).to_dict()
    assert key(config=changed) != first
    monkeypatch.chdir(tmp_path)
    assert key(["a.png", "b.png"]) == first  # the same files by other words
    with monkeypatch.context() as patch:
        patch.setattr("zpm2.files.keys.code", lambda: "other")
        assert key() != first
    assert key() == first
    photograph(paths[1], 5)
    assert key() != first


def test_the_key_of_a_file_that_is_read_by_windows(tmp_path):
    pytest.importorskip("rasterio")
    path = photograph(tmp_path / "a.tif")
    with open_raster(path) as source:
        first = tiles.key([source], {}, "")
        assert tiles.key([source], {}, "") == first
        os.utime(path, ns=(1, 1))
        assert tiles.key([source], {}, "") != first


def test_the_key_of_a_mosaic_is_that_of_its_parts(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    pixels = np.random.default_rng(0).integers(0, 255, (3, 60, 80), np.uint8)
    with rasterio.open(
        tmp_path / "a.tif", "w", driver="GTiff", width=80, height=60, count=3, dtype="uint8", crs="EPSG:32633",
        transform=rasterio.Affine(1, 0, 500_000, 0, -1, 5_000_000),
    ) as file:  # fmt: skip
        file.write(pixels)
    bands = "".join(
        f'<VRTRasterBand dataType="Byte" band="{k}"><SimpleSource><SourceFilename relativeToVRT="1">a.tif'
        f"</SourceFilename><SourceBand>{k}</SourceBand></SimpleSource></VRTRasterBand>"
        for k in (1, 2, 3)
    )
    (tmp_path / "a.vrt").write_text(f'<VRTDataset rasterXSize="80" rasterYSize="60">{bands}</VRTDataset>')

    def key():
        with open_raster(tmp_path / "a.vrt") as source:
            return tiles.key([source], {}, "")

    first = key()
    assert key() == first
    os.utime(tmp_path / "a.tif", ns=(1, 1))
    assert key() != first


def test_the_key_of_pixels_is_that_of_their_content():
    pixels = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)
    other = pixels.copy()
    other[30, 40, 1] ^= 1
    one, same, two = (tiles.key([InMemoryPhoto(Image(p))], {}, "") for p in (pixels, pixels.copy(), other))
    assert one == same != two
    assert one == tiles.key([InMemoryPhoto(Image(pixels, "no/such/file.png"))], {}, "")
    missing = np.ones((60, 80), bool)
    missing[:, :20] = False
    assert one != tiles.key([InMemoryPhoto(Image(pixels, None, (), missing))], {}, "")


# --- from a result


def test_a_pair_comes_back_in_px_of_the_photographs():
    rng = np.random.default_rng(0)
    sources = [InMemoryPhoto(Image(rng.integers(0, 255, (800, 800, 3), np.uint8))) for _ in range(2)]
    windows = (100, 50, 500, 450), (0, 200, 400, 600)
    views = (
        read_view(sources[0], windows[0], reduced_size(windows[0], 2.0)),
        read_view(sources[1], windows[1], reduced_size(windows[1], 1.0), np.pi / 2),
    )
    square = np.array([[10, 20], [40, 20], [40, 60], [10, 60]], float)
    left = ImagePolygons(200, 200, [Polygon(0, square), Polygon(1, square + 100, (), 0.7)])
    right = ImagePolygons(400, 400, [Polygon(0, square)])
    points = PointMatches(np.array([[0.0, 0], [200, 200]]), np.array([[0.0, 0], [400, 400]]), np.ones(2))
    matches = [PolygonMatch(1, 0, 0.9, 1.0, 3, "guided")]
    none = Failed("no")
    result = MatchResult(left, right, matches, points, none, none, {}, {"points": 1.5})
    tile = tiles.tile_of_pair(1, windows, views, result)
    assert (tile.level, tile.windows, dict(tile.seconds)) == (1, windows, {"points": 1.5})
    assert tile.polygons[0][0].bounds == (120, 90, 180, 170)
    assert tile.polygons[0][1].bounds == (320, 290, 380, 370)
    assert tile.polygons[0][1].score == 0.7
    assert np.allclose(tile.points.left, [[100, 50], [500, 450]])
    assert np.allclose(tile.points.right, [[0, 600], [400, 200]])  # turned by 90 degrees from x to y: (0, 0) is below
    assert np.allclose(tile.polygons[1][0].bounds, (20, 560, 60, 590))
    assert tile.guided.tolist() == [[1, 0]]
    unguided = tiles.tile_of_pair(1, windows, views, dataclasses.replace(result, matches=[]))
    assert unguided.guided.shape == (0, 2)


def test_pixels_that_are_given_with_the_path_of_a_file_are_not_the_file(tmp_path):
    path = str(photograph(tmp_path / "a.png"))
    image = open_source(path).read()
    assert tiles.key([InMemoryPhoto(image)], {}, "") == tiles.key([open_source(path)], {}, "")
    assert tiles.key([InMemoryPhoto(Image(255 - image.rgb, path))], {}, "") != tiles.key([open_source(path)], {}, "")


def test_windows_that_have_nothing_in_common():
    source = InMemoryPhoto(Image(np.zeros((300, 300, 3), np.uint8)))
    seen = read_view(source, (100, 100, 300, 300), (100, 100))
    square = Polygon(5, np.array([[10, 10], [20, 10], [20, 20], [10, 20]], float))
    tile = tiles.tile_without_partner(1, (None, (100, 100, 300, 300)), [None, (seen, [square])], 0.5)
    assert list(tile.polygons[0]) == []
    assert [(p.id, p.bounds) for p in tile.polygons[1]] == [(0, (120, 120, 140, 140))]
    assert (len(tile.points), tile.guided.shape, dict(tile.seconds)) == (0, (0, 2), {"detect": 0.5})
