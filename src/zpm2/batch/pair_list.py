"""The list of pairs: of a table, or of a folder of photographs."""

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import astuple, replace
from pathlib import Path

from zpm2.batch.entries import Pair, absolute
from zpm2.batch.list_table import TextTable, free_name, stem
from zpm2.config import Config
from zpm2.errors import ConfigError, InputError
from zpm2.runtime import Progress, resolve_device
from zpm2.tracking.pairs import choose_pairs
from zpm2.tracking.photographs import read_photographs


def read_pairs(place: str | Path) -> list[Pair]:
    """The pairs of a table: .parquet, or else CSV, with a line of column names. It may be an address that fsspec knows.

    Columns: `left` and `right`, and where wanted `name` (of the pair's folder), `regions`, `K` and `K2`; others are not
    read. Paths are seen from the folder of the list. `InputError` says what is wrong in which row.
    """
    return named(str(place), _pairs(TextTable(place, Pair.header, ("left", "right"))))


def pairs_of_folder(
    folder: str | Path, way: str | Path, config: Config, progress: Progress = lambda stage, share: None
) -> tuple[list[Pair], list[str]]:
    """The pairs of a folder of photographs, chosen as for `zpm2.tracks` (`tracking.pairs`), and warnings about that."""
    photographs = read_photographs([folder], config.raster)
    chosen = choose_pairs(photographs, way, config, resolve_device(config.device), progress)
    paths = [os.path.abspath(each.path) for each in photographs]
    return named(str(folder), (Pair("", paths[i], paths[j]) for i, j in chosen.pairs)), list(chosen.warnings)


def named(place: str, pairs: Iterable[Pair]) -> list[Pair]:
    """The pairs with names: their own, or else those of their photographs, `LEFT_RIGHT`, with a number where that is
    taken by an earlier pair. `InputError` for a name that an earlier pair has, and for a pair that is there twice."""
    taken: dict[str, int] = {}
    counts: dict[str, int] = {}
    seen: dict[tuple[str | None, ...], int] = {}
    found = []
    for row, pair in enumerate(pairs, start=1):
        if (first := seen.setdefault(astuple(pair)[1:], row)) != row:
            raise InputError(f"{place}: row {row} is the same pair as row {first}: remove one")
        if other := taken.get(pair.name.casefold()):
            raise InputError(f"{place}: rows {other} and {row} are both {pair.name}: choose another name for row {row}")
        name = pair.name or free_name(f"{stem(pair.left)}_{stem(pair.right)}", taken, counts)
        taken[name.casefold()] = row
        found.append(replace(pair, name=name))
    return found


def part_of(count: int, shard: str) -> range:
    """The rows of shard "i/n", i from 1 to n. Neighbours stay together, as they often have a photograph in common.
    `ConfigError` for another text."""
    found = re.fullmatch(r"([1-9][0-9]{0,8})/([1-9][0-9]{0,8})", shard)
    if found is None or int(found[1]) > int(found[2]):
        raise ConfigError(f"--shard {shard}: give i/n, i from 1 to n, as 3/8")
    i, n = int(found[1]), int(found[2])
    return range(count * (i - 1) // n, count * i // n)


def _pairs(table: TextTable) -> Iterator[Pair]:
    for row, texts in table.rows():
        if not texts["left"] or not texts["right"]:
            raise InputError(f"{table.place}, row {row} lacks a photograph: give left and right")
        if texts["name"]:
            table.check_name(row, texts["name"])
        left, right, regions = (texts[each] and absolute(texts[each], table.folder) for each in Pair.header[1:4])
        yield Pair(texts["name"], left, right, regions or None, texts["K"] or None, texts["K2"] or None)
