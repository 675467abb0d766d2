"""The list of groups of photographs: of a table, or of a folder of folders."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from zpm2.batch.entries import Group, absolute
from zpm2.batch.list_table import TextTable, folder_name, free_name
from zpm2.errors import InputError
from zpm2.files.listing import folders
from zpm2.photos.listing import photographs


def read_groups(place: str | Path) -> list[Group]:
    """The groups of a table: .parquet, or else CSV, with a line of column names. It may be an address that fsspec
    knows.

    Columns: `group`, the name of the group's folder, and `photograph`, one of its photographs, or a folder of them;
    others are not read. The lines of a group may stand anywhere. Paths are seen from the folder of the list.
    `InputError` says what is wrong in which row.
    """
    table = TextTable(place, Group.header, Group.header)
    members: dict[str, list[str]] = {}
    spelled: dict[str, str] = {}
    for row, texts in table.rows():
        name, photograph = texts["group"], texts["photograph"]
        if not name or not photograph:
            raise InputError(f"{table.place}, row {row} lacks a name or a photograph: give group and photograph")
        table.check_name(row, name)
        if (first := spelled.setdefault(name.casefold(), name)) != name:
            raise InputError(f"{table.place}, row {row}: {name} is {first} in other letters: spell it the same")
        members.setdefault(name, []).append(absolute(photograph, table.folder))
    return [Group(name, tuple(_files(paths))) for name, paths in members.items()]


def groups_of_folder(folder: str | Path) -> list[Group]:
    """A group of each folder in that folder that holds photographs itself, in the natural order of their names.
    `InputError` where there is none."""
    taken: dict[str, int] = {}
    counts: dict[str, int] = {}
    inside = [place for place in folders(Path(folder)) if photographs(place)]
    found = [(place, tuple(_files([os.path.abspath(place)]))) for place in inside]
    if not found:
        raise InputError(f"{folder} has no folders with photographs in it: give a folder of one folder for each group")
    return [Group(free_name(folder_name(place.name), taken, counts), files) for place, files in found]


def _files(places: Iterable[str]) -> Iterator[str]:
    """The photographs, and those of folders. A folder without any stays, and fails when its turn comes."""
    for place in places:
        inside = photographs(Path(place)) if os.path.isdir(place) else []
        yield from map(str, inside) if inside else [place]
