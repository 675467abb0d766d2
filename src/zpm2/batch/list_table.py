"""Tables of texts: CSV, Parquet, on a disk or at an address."""

import csv
import io
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from zpm2.batch import remote
from zpm2.batch.tables import read_columns
from zpm2.errors import InputError
from zpm2.files import reading
from zpm2.formats.parquet import require_pyarrow

STEM = 60  # letters of a photograph's name that are taken into that of its pair
_NAME = re.compile(r"[\w][\w.+-]*")


class TextTable:
    """A list, .parquet or else CSV, with a line of column names. `place` may be an address that fsspec knows.

    `folder`: from which its paths are seen; "" for an address. `InputError` where it cannot be read, or lacks one of
    the columns `needed`.
    """

    def __init__(self, place: str | Path, columns: Sequence[str], needed: Sequence[str]) -> None:
        self.place = str(place)
        address = remote.is_address(self.place)
        content = remote.read(self.place) if address else _bytes(Path(self.place))
        is_parquet = self.place.lower().endswith((".parquet", ".pq"))
        self._columns, self._names = (_parquet if is_parquet else _csv)(self.place, content, columns), columns
        self.folder = "" if address else os.path.dirname(os.path.abspath(self.place))
        missing = [name for name in needed if name not in self._columns]
        if missing:
            raise InputError(
                f"{self.place} has no column {' and '.join(missing)}: give a table with {' and '.join(needed)}"
            )

    def rows(self) -> Iterator[tuple[int, dict[str, str]]]:
        """Each row with its number, from 1: a text for each column, "" where it has none. `InputError` names the row
        that holds something else."""
        for row, values in enumerate(zip(*self._columns.values(), strict=True), start=1):
            texts = dict.fromkeys(self._names, "")
            for name, value in zip(self._columns, values, strict=True):
                if value is not None and not isinstance(value, str):
                    raise InputError(f"{self.place}, row {row}: {name} is {type(value).__name__}, not text: correct it")
                texts[name] = (value or "").strip()
            if any(not text.isprintable() for text in texts.values()):
                raise InputError(f"{self.place}, row {row} holds what cannot be printed: correct it")
            yield row, texts

    def check_name(self, row: int, name: str) -> None:
        """`InputError` for what cannot name a folder."""
        if len(name) > 2 * STEM + 20 or not _NAME.fullmatch(name):
            raise InputError(
                f"{self.place}, row {row}: no folder can be named {name[:40]!r}: give letters, digits, . + - _"
            )


def _csv(place: str, content: bytes, columns: Sequence[str]) -> dict[str, Sequence[object]]:
    try:
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{place} is not a CSV file of UTF-8 ({error}): give one, or .parquet") from error
    lines = [line for line in lines if any(cell.strip() for cell in line)]
    header = [cell.strip() for cell in lines[0]] if lines else []
    for row, line in enumerate(lines[1:], start=1):
        if len(line) != len(header):
            raise InputError(f"{place}, row {row} has {len(line)} cells, the first line {len(header)}: correct it")
    return {name: [line[header.index(name)] for line in lines[1:]] for name in columns if name in header}


def _parquet(place: str, content: bytes, columns: Sequence[str]) -> dict[str, Sequence[object]]:
    require_pyarrow(f"{place} is a Parquet file, which")
    return dict(read_columns(content, place, list(columns)))


def _bytes(file: Path) -> bytes:
    try:
        return reading.read_bytes(file)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}; give a CSV or Parquet file, or a folder") from error


def stem(path: str) -> str:
    """The name of a file without its ending, as a part of a folder's name."""
    return folder_name(Path(path).stem)


def folder_name(text: str) -> str:
    """A text as a part of a folder's name."""
    return re.sub(r"[^\w.+-]", "_", text)[:STEM].lstrip(".-+") or "_"


def free_name(name: str, taken: dict[str, int], counts: dict[str, int]) -> str:
    """The name, or with the next number that is free; the case of letters makes no other one. It is taken then."""
    chosen, key = name, name.casefold()
    while chosen.casefold() in taken:
        counts[key] = counts.get(key, 1) + 1
        chosen = f"{name}_{counts[key]}"
    taken[chosen.casefold()] = 0
    return chosen
