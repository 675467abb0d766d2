"""The list of pairs: tables, folders, names, shards."""

import os
from pathlib import Path

import PIL.Image
import pytest

from zpm2.batch import Pair, pairs_of_folder, read_pairs, save_list
from zpm2.batch.pair_list import named, part_of
from zpm2.config import assign, preset
from zpm2.errors import ConfigError, InputError


def test_a_table_with_all_columns(tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text(
        "\ufeffright,left,K,epoch,name,regions\nb.png,sub/a.png,guess,2019,first,a.geojson\n\nb.png,/x/c.png,,,,\n",
        encoding="utf-8",
    )
    first, second = read_pairs(tmp_path / "pairs.csv")
    home = str(tmp_path)
    assert first == Pair("first", f"{home}/sub/a.png", f"{home}/b.png", f"{home}/a.geojson", "guess")
    assert second == Pair("c_b", "/x/c.png", f"{home}/b.png")


def test_a_parquet_table_says_the_same(tmp_path: Path) -> None:
    arrow, tables = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = arrow.table({"left": ["a.png", "c.png"], "right": ["b.png", "d.png"], "K": [None, "guess"], "n": [1, 2]})
    tables.write_table(table, tmp_path / "pairs.parquet")
    (tmp_path / "pairs.csv").write_text("left,right,K\na.png,b.png,\nc.png,d.png,guess\n")
    assert read_pairs(tmp_path / "pairs.parquet") == read_pairs(tmp_path / "pairs.csv")


def test_a_list_comes_back_as_it_was_written(tmp_path: Path) -> None:
    pairs = named(
        "list", [Pair("", "/a,b/c.png", '/"d".png', None, "1,2,3,4"), Pair("n", "/é.png", "/d.png", "/r.json")]
    )
    assert read_pairs(save_list(pairs, tmp_path)) == pairs


def test_names_are_readable_unique_and_stable() -> None:
    rows = [("/1/left.png", "/1/right.png"), ("/2/left.png", "/2/right.png"), ("/3/LEFT.png", "/3/right.png")]
    rows += [("/.x y.tif", "/ü/a.b.png"), ("/" + "z" * 300 + ".png", "/r.png")]
    pairs = named("list", [Pair("left_right_2", "/4.png", "/5.png")] + [Pair("", *row) for row in rows])
    names = [pair.name for pair in pairs]
    assert names[1:5] == ["left_right", "left_right_3", "LEFT_right_4", "x_y_a.b"]
    assert len({name.casefold() for name in names}) == len(names)
    assert max(map(len, names)) < 130
    assert named("list", [Pair("", *row) for row in rows])[0].name == names[1]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "no column left and right"),
        ("left,wrong\na,b\n", "no column right"),
        ("left,right\na\n", "row 1 has 1 cells"),
        ("left,right\na,\n", "row 1 lacks a photograph"),
        ("left,right\na,b\na,b\n", "row 2 is the same pair as row 1"),
        ("left,right,name\na,b,n\na,c,N\n", "rows 1 and 2 are both N"),
        ("left,right,name\na,b,\nc,d,\nx,y,A_b\n", "rows 1 and 3 are both A_b: choose another name for row 3"),
        ("left,right,name\na,b,../up\n", "no folder can be named"),
        ("left,right,name\na,b,.hidden\n", "no folder can be named"),
        ('left,right\n"a,b\n', "not a CSV file"),
        ("left,right\na\0,b\n", "cannot be printed|not a CSV"),
        ("left,right\n\x1b[2J,b\n", "cannot be printed"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, text: str, what: str) -> None:
    (tmp_path / "pairs.csv").write_text(text)
    with pytest.raises(InputError, match=what):
        read_pairs(tmp_path / "pairs.csv")


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_pairs(tmp_path / "none.csv")
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="CSV"):
        read_pairs(tmp_path / "a.csv")
    pytest.importorskip("pyarrow")
    (tmp_path / "a.parquet").write_bytes(b"PAR1nonsense")
    with pytest.raises(InputError, match="not a Parquet file"):
        read_pairs(tmp_path / "a.parquet")


def test_a_folder_is_paired_as_for_tracks(tmp_path: Path) -> None:
    for k in range(4):
        PIL.Image.new("RGB", (64, 48), (60 * k, 0, 0)).save(tmp_path / f"p{k}.png")
    config = assign(preset("default"), ["device=cpu"])
    pairs, warnings = pairs_of_folder(tmp_path, "sequential", config)
    assert [pair.name for pair in pairs] == ["p0_p1", "p0_p2", "p1_p2", "p1_p3", "p2_p3"]
    assert all(os.path.isabs(pair.left) for pair in pairs)
    assert warnings == []
    with pytest.raises(InputError, match="exif-gps needs a position"):
        pairs_of_folder(tmp_path, "exif-gps", config)


def test_shards_are_all_of_the_list_once() -> None:
    for count in (0, 1, 7, 100):
        for n in (1, 2, 3, 8):
            rows = [row for i in range(1, n + 1) for row in part_of(count, f"{i}/{n}")]
            assert rows == list(range(count))
    for text in ("0/2", "3/2", "1", "a/b", "1/0", "-1/2", "1/2/3"):
        with pytest.raises(ConfigError, match="--shard"):
            part_of(10, text)
