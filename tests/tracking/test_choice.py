"""Which photographs are matched with each other."""

import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from zpm2.config import assign, preset
from zpm2.errors import ConfigError, InputError
from zpm2.formats.colmap import shared_points
from zpm2.tracking import pairs as choosing
from zpm2.tracking.pairs import ChosenPairs, choose_pairs
from zpm2.tracking.photographs import Photograph

CONFIG = preset("default")


def photographs(count: int, positions: list[tuple[float, float]] | None = None) -> list[Photograph]:
    at = [None] * count if positions is None else [np.array(position) for position in positions]
    return [Photograph(f"p{k}.png", f"/photos/p{k}.png", 40, 30, position=at[k]) for k in range(count)]


def chosen(of: list[Photograph], way: str | Path, *settings: str) -> ChosenPairs:
    return choose_pairs(of, way, assign(CONFIG, list(settings)), "cpu", lambda stage, share: None)


def database(path: Path, pairs: dict[tuple[int, int], int], names: dict[int, str]) -> Path:
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT)")
        file.execute("CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER)")
        file.executemany("INSERT INTO images VALUES (?, ?)", names.items())
        rows = [(2147483647 * a + b, count) for (a, b), count in pairs.items()]
        file.executemany("INSERT INTO two_view_geometries VALUES (?, ?)", rows)
    return path


def test_neighbours_and_all() -> None:
    assert chosen(photographs(4), "sequential").pairs == [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)]
    assert chosen(photographs(4), "sequential", "tracks.window=1").pairs == [(0, 1), (1, 2), (2, 3)]
    assert len(chosen(photographs(5), "exhaustive").pairs) == 10


def test_the_nearest_by_position() -> None:
    line = [(11.0 + k * 1e-4, 48.0) for k in (0, 5, 1, 6)]
    found = chosen(photographs(4, line), "auto", "tracks.neighbors=1")
    assert found.pairs == [(0, 2), (1, 3)]
    assert "position" in found.how


def test_the_most_points_where_positions_lack_or_are_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {(0, 1): 90, (0, 2): 40, (1, 2): 60, (2, 3): 3}
    monkeypatch.setattr(choosing, "agreeing_points", lambda p, looked, *more: [counts.get(pair, 0) for pair in looked])
    for of in (photographs(4), photographs(4, [(1.0, 2.0)] * 4)):
        found = chosen(of, "auto", "tracks.neighbors=1")
        assert found.pairs == [(0, 1), (1, 2)]
        assert "points" in found.how
        assert found.warnings == ("p3.png is matched with no other photograph (auto, by points)",)


def test_not_all_pairs_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choosing, "agreeing_points", lambda p, looked, *more: [50] * len(looked))
    found = chosen(photographs(4), "auto", "tracks.max_looks=3")
    assert found.pairs == [(0, 1), (1, 2), (2, 3)]
    assert "of 6 pairs only the 3 nearest by name" in found.warnings[0]


def test_a_list(tmp_path: Path) -> None:
    file = tmp_path / "pairs.txt"
    file.write_text("# two a line\np1.png p0.png\n\np0.png,p2.png\nphotos/p2.png\tp3.png\n")
    assert chosen(photographs(4), file).pairs == [(0, 1), (0, 2), (2, 3)]
    file.write_text("p0.png p1.png\np1.png\n")
    with pytest.raises(InputError, match="line 2 has 1 names"):
        chosen(photographs(4), file)
    file.write_text("p0.png p9.png\n")
    with pytest.raises(InputError, match=r"p9.png, which is none of the photographs"):
        chosen(photographs(4), file)
    file.write_text("p0.png p0.png\n")
    with pytest.raises(InputError, match="no pair of photographs"):
        chosen(photographs(4), file)


def test_the_same_file_name_in_two_folders(tmp_path: Path) -> None:
    names = ("a.png", "b.png", "sub/a.png")
    own = [Photograph(name, f"/photos/{name}", 40, 30) for name in names]
    file = tmp_path / "pairs.txt"
    file.write_text("a.png b.png\nb.png sub/a.png\n")
    assert chosen(own, file).pairs == [(0, 1), (1, 2)]
    assert chosen(own, database(tmp_path / "database.db", {(1, 3): 50}, dict(enumerate(names, 1)))).pairs == [(0, 2)]


def test_a_database_of_colmap(tmp_path: Path) -> None:
    names = {1: "photos/p0.png", 2: "p1.png", 5: "p2.png", 7: "other.png"}
    file = database(tmp_path / "database.db", {(1, 2): 50, (1, 5): 0, (2, 5): 20, (5, 7): 99}, names)
    found = chosen(photographs(3), file)
    assert found.pairs == [(0, 1), (1, 2)]
    assert "other.png" in found.warnings[0]


def test_the_database_beside_the_photographs(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    own = [Photograph(f"p{k}.png", str(tmp_path / "images" / f"p{k}.png"), 40, 30) for k in range(2)]
    with pytest.raises(InputError, match=r"no database.db"):
        chosen(own, "colmap")
    database(tmp_path / "database.db", {(1, 2): 50}, {1: "p0.png", 2: "p1.png"})
    assert chosen(own, "colmap").pairs == [(0, 1)]


def text_model(folder: Path, points: dict[str, list[int]]) -> Path:
    folder.mkdir()
    (folder / "cameras.txt").write_text("1 PINHOLE 40 30 40 40 20 15\n")
    lines = [
        f"{k} 1 0 0 0 0 0 0 1 {name}\n{' '.join(f'1.5 2.5 {id}' for id in ids)}\n"
        for k, (name, ids) in enumerate(points.items(), start=1)
    ]
    (folder / "images.txt").write_text("".join(lines))
    return folder


def binary_model(folder: Path, points: dict[str, list[int]]) -> Path:
    folder.mkdir()
    camera = struct.pack("<QIiQQ4d", 1, 1, 1, 40, 30, 40, 40, 20, 15)
    (folder / "cameras.bin").write_bytes(camera)
    images = struct.pack("<Q", len(points))
    for k, (name, ids) in enumerate(points.items(), start=1):
        images += struct.pack("<I7dI", k, 1, 0, 0, 0, 0, 0, 0, 1) + name.encode() + b"\0"
        images += struct.pack("<Q", len(ids)) + b"".join(struct.pack("<ddq", 1.5, 2.5, id) for id in ids)
    (folder / "images.bin").write_bytes(images)
    return folder


@pytest.mark.parametrize("write", [text_model, binary_model])
def test_a_model_of_colmap(tmp_path: Path, write: Callable[[Path, dict[str, list[int]]], Path]) -> None:
    points = {
        "p1.png": [*range(30), -1, -1],
        "p0.png": [*range(25), 99, 99],
        "p2.png": [-1, *range(5, 30)],
        "more.png": [],
    }
    found = chosen(photographs(3), write(tmp_path / "model", points), "tracks.neighbors=1")
    assert found.pairs == [(0, 1), (1, 2)]  # 0 and 2 share 20, too, but each has a better one
    assert "more.png" in found.warnings[0]
    names, shared = shared_points(tmp_path / "model")
    assert names == ["more.png", "p0.png", "p1.png", "p2.png"]
    assert shared.tolist() == [[0, 0, 0, 0], [0, 26, 25, 20], [0, 25, 30, 25], [0, 20, 25, 25]]
    lonely = write(tmp_path / "without points", {"p0.png": [], "p1.png": [-1]})
    with pytest.raises(InputError, match="no pair of photographs"):
        chosen(photographs(3), lonely)


def test_misuse(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--pairs sequentially: give one of auto, sequential"):
        chosen(photographs(3), "sequentially")
    (tmp_path / "bad.db").write_text("no database")
    with pytest.raises(InputError, match="not a complete"):
        chosen(photographs(3), tmp_path / "bad.db")
    with pytest.raises(InputError, match="not there"):
        chosen(photographs(3), tmp_path / "none.db")
    with pytest.raises(InputError, match="no verified matches"):
        chosen(photographs(2), database(tmp_path / "empty.db", {(1, 2): 0}, {1: "p0.png", 2: "p1.png"}))
