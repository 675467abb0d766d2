"""The list of pairs: of a table (CSV, Parquet), or of a folder of photographs."""

import csv
import io
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

from zpm2.batch import remote
from zpm2.batch.tables import read_columns
from zpm2.config import Config
from zpm2.errors import ConfigError, InputError
from zpm2.files import reading
from zpm2.formats.parquet import require_pyarrow
from zpm2.runtime import Progress, resolve_device
from zpm2.tracking.pairs import choose_pairs
from zpm2.tracking.photographs import read_photographs

STEM = 60  # letters of a photograph's name that are taken into that of its pair
_NAME = re.compile(r"[\w][\w.+-]*")


@dataclass(frozen=True)
class Pair:
    """Two photographs of a list."""

    name: str  # of its folder, unique in the list
    left: str  # absolute paths
    right: str
    regions: str | None = None  # of the left photograph, for `carry`
    k: str | None = None  # cameras as `--K` takes them, for `pose`
    k2: str | None = None


_COLUMNS = {"name": "name", "left": "left", "right": "right", "regions": "regions", "k": "K", "k2": "K2"}  # by field


def read_pairs(place: str | Path) -> list[Pair]:
    """The pairs of a table: .parquet, or else CSV, with a line of column names. It may be an address that fsspec knows.

    Columns: `left` and `right`, and where wanted `name` (of the pair's folder), `regions`, `K` and `K2`; others are not
    read. Paths are seen from the folder of the list. `InputError` says what is wrong in which row.
    """
    text = str(place)
    content = remote.read(text) if remote.is_address(text) else _bytes(Path(text))
    is_parquet = text.lower().endswith((".parquet", ".pq"))
    columns = _parquet(text, content) if is_parquet else _csv(text, content)
    folder = "" if remote.is_address(text) else os.path.dirname(os.path.abspath(text))
    return named(text, (_absolute(pair, folder) for pair in _pairs(text, columns)))


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
    taken by an earlier pair. `InputError` for a name that two have, and for a pair that is there twice."""
    listed = list(pairs)
    taken: dict[str, int] = {}
    seen: dict[tuple[str | None, ...], int] = {}
    for row, pair in enumerate(listed, start=1):
        if (first := seen.setdefault(astuple(pair)[1:], row)) != row:
            raise InputError(f"{place}: row {row} is the same pair as row {first}: remove one")
        if pair.name and taken.setdefault(pair.name.casefold(), row) != row:
            raise InputError(f"{place}: rows {taken[pair.name.casefold()]} and {row} are both {pair.name}: rename one")
    counts: dict[str, int] = {}
    found = []
    for pair in listed:
        name = pair.name or _free(f"{_stem(pair.left)}_{_stem(pair.right)}", taken, counts)
        found.append(replace(pair, name=name))
    return found


def to_csv(pairs: Iterable[Pair]) -> str:
    """The pairs as `read_pairs` reads them."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(_COLUMNS[field.name] for field in fields(Pair))
    lines.writerows(astuple(pair) for pair in pairs)
    return out.getvalue()


def part_of(count: int, shard: str) -> range:
    """The rows of shard "i/n", i from 1 to n. Neighbours stay together, as they often have a photograph in common.
    `ConfigError` for another text."""
    found = re.fullmatch(r"([1-9][0-9]{0,8})/([1-9][0-9]{0,8})", shard)
    if found is None or int(found[1]) > int(found[2]):
        raise ConfigError(f"--shard {shard}: give i/n, i from 1 to n, as 3/8")
    i, n = int(found[1]), int(found[2])
    return range(count * (i - 1) // n, count * i // n)


def _pairs(place: str, columns: dict[str, Sequence[object]]) -> Iterator[Pair]:
    missing = [name for name in ("left", "right") if name not in columns]
    if missing:
        raise InputError(f"{place} has no column {' and '.join(missing)}: give a table with left and right")
    for row, values in enumerate(zip(*columns.values(), strict=True), start=1):
        texts = dict.fromkeys(_COLUMNS.values(), "")
        for name, value in zip(columns, values, strict=True):
            if value is not None and not isinstance(value, str):
                raise InputError(f"{place}, row {row}: {name} is {type(value).__name__}, not text: correct it")
            texts[name] = (value or "").strip()
        if not texts["left"] or not texts["right"]:
            raise InputError(f"{place}, row {row} lacks a photograph: give left and right")
        if texts["name"] and (len(texts["name"]) > 2 * STEM + 20 or not _NAME.fullmatch(texts["name"])):
            name = texts["name"][:40]
            raise InputError(f"{place}, row {row}: no folder can be named {name!r}: give letters, digits, . + - _")
        if any(not text.isprintable() for text in texts.values()):
            raise InputError(f"{place}, row {row} holds what cannot be printed: correct it")
        more = (texts[each] or None for each in ("regions", "K", "K2"))
        yield Pair(texts["name"], texts["left"], texts["right"], *more)


def _csv(place: str, content: bytes) -> dict[str, Sequence[object]]:
    try:
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{place} is not a CSV file of UTF-8 ({error}): give one, or .parquet") from error
    lines = [line for line in lines if any(cell.strip() for cell in line)]
    header = [cell.strip() for cell in lines[0]] if lines else []
    for row, line in enumerate(lines[1:], start=1):
        if len(line) != len(header):
            raise InputError(f"{place}, row {row} has {len(line)} cells, the first line {len(header)}: correct it")
    return {name: [line[header.index(name)] for line in lines[1:]] for name in _COLUMNS.values() if name in header}


def _parquet(place: str, content: bytes) -> dict[str, Sequence[object]]:
    require_pyarrow(f"{place} is a Parquet file, which")
    return dict(read_columns(content, place, list(_COLUMNS.values())))


def _bytes(file: Path) -> bytes:
    try:
        return reading.read_bytes(file)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}; give a CSV or Parquet file, or a folder") from error


def _absolute(pair: Pair, folder: str) -> Pair:
    """Paths from the folder of the list; "" where that is an address, from which no photograph is read."""

    def absolute(path: str) -> str:
        return os.path.abspath(os.path.join(folder, path))

    regions = None if pair.regions is None else absolute(pair.regions)
    return replace(pair, left=absolute(pair.left), right=absolute(pair.right), regions=regions)


def _stem(path: str) -> str:
    return re.sub(r"[^\w.+-]", "_", Path(path).stem)[:STEM].lstrip(".-+") or "_"


def _free(name: str, taken: dict[str, int], counts: dict[str, int]) -> str:
    """The name, or with the next number that is free; the case of letters makes no other one."""
    chosen, key = name, name.casefold()
    while chosen.casefold() in taken:
        counts[key] = counts.get(key, 1) + 1
        chosen = f"{name}_{counts[key]}"
    taken[chosen.casefold()] = 0
    return chosen
