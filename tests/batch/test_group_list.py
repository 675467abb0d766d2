"""The list of groups: tables, folders of folders."""

import re
from pathlib import Path

import pytest

from zpm2.batch import Group, groups_of_folder, read_groups, save_list
from zpm2.errors import InputError


def photographs(folder: Path, *names: str) -> list[str]:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"")
    return [str(folder / name) for name in names]


def test_lines_of_a_group_may_stand_anywhere_and_name_folders(tmp_path: Path) -> None:
    inside = photographs(tmp_path / "scan", "p2.jpg", "p10.jpg")
    (tmp_path / "scan" / "notes.txt").write_text("no photograph")
    (tmp_path / "groups.csv").write_text("photograph,group,epoch\na.png,house,1\nscan,rock,\n\n/x/b.png,house,2\n")
    assert read_groups(tmp_path / "groups.csv") == [
        Group("house", (f"{tmp_path}/a.png", "/x/b.png")),
        Group("rock", tuple(inside)),
    ]


def test_a_list_comes_back_as_it_was_written(tmp_path: Path) -> None:
    groups = [Group("a", ("/p,1.png", "/p2.png")), Group("b", ("/é.png",))]
    place = save_list(groups, tmp_path)
    assert place.endswith("groups.csv")
    assert read_groups(place) == groups
    arrow, tables = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = {"group": ["a", "b", "a"], "photograph": ["/p,1.png", "/é.png", "/p2.png"]}
    tables.write_table(arrow.table(columns), tmp_path / "groups.parquet")
    assert read_groups(tmp_path / "groups.parquet") == groups


def test_folders_of_a_folder(tmp_path: Path) -> None:
    second, first = photographs(tmp_path / "site 10", "a.tif", "b.tif"), photographs(tmp_path / "site 2", "a.tif")
    photographs(tmp_path / ".hidden", "a.tif")
    (tmp_path / "empty").mkdir()
    assert groups_of_folder(tmp_path) == [Group("site_2", tuple(first)), Group("site_10", tuple(second))]
    with pytest.raises(InputError, match="no folders with photographs"):
        groups_of_folder(tmp_path / "site 2")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "no column group and photograph"),
        ("group,photo\na,b\n", "no column photograph"),
        ("group,photograph\na,\n", "row 1 lacks"),
        ("group,photograph\n,b.png\n", "row 1 lacks"),
        ("group,photograph\n../a,b.png\n", "no folder can be named"),
        ("group,photograph\nA,b.png\na,c.png\n", "row 2: a is A in other letters"),
        ("group,photograph\na,b\x1b.png\n", "cannot be printed"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, text: str, what: str) -> None:
    (tmp_path / "groups.csv").write_text(text)
    with pytest.raises(InputError, match=re.escape(what)):
        read_groups(tmp_path / "groups.csv")
