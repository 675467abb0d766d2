"""Parquet: lists of pairs that are read, and the index of results, which grows."""

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

from zpm2 import memory
from zpm2.errors import InputError
from zpm2.files.reading import WRONG

if TYPE_CHECKING:
    import pyarrow

Value = int | float | str | Sequence[float] | None
Kind = Literal["int", "float", "text", "floats"]
Columns = Mapping[str, Kind]
NOTE = b"zpm2"  # key of what a file says of itself
CHUNK = 4096  # rows that are kept as Python's before they are packed
ROW_BYTES = 1000  # about, of a row as Python's


def read_columns(content: bytes, place: str, wanted: Sequence[str] | None = None) -> dict[str, list[object]]:
    """The columns of a Parquet file, or those of them that are wanted. `InputError` where it is damaged."""
    table = _table(content, place, wanted)
    return {name: table[name].to_pylist() for name in table.column_names}


def read_note(content: bytes, place: str) -> dict[str, object]:
    """What a file of `IndexTable` says of itself; nothing for others. `InputError` where it is damaged."""
    import pyarrow.parquet

    try:
        note = json.loads((pyarrow.parquet.read_schema(io.BytesIO(content)).metadata or {}).get(NOTE, b"{}"))
    except (pyarrow.ArrowException, OSError, MemoryError, *WRONG) as error:
        raise InputError(f"{place} is not a Parquet file that can be read: run the batch again") from error
    return note if isinstance(note, dict) else {}


class IndexTable:
    """Rows of an index, packed as they come. `columns` names them and their kinds; the first one is the order."""

    def __init__(self, columns: Columns) -> None:
        import pyarrow

        kinds = {
            "int": pyarrow.int64(),
            "float": pyarrow.float64(),
            "text": pyarrow.string(),
            "floats": pyarrow.list_(pyarrow.float64()),
        }
        self.schema = pyarrow.schema([(name, kinds[kind]) for name, kind in columns.items()])
        self._rows: list[Mapping[str, Value]] = []
        self._packed: list[pyarrow.RecordBatch] = []

    def __len__(self) -> int:
        return len(self._rows) + sum(batch.num_rows for batch in self._packed)

    def add(self, row: Mapping[str, Value]) -> None:
        """A row by the names of its columns; what it lacks is null."""
        self._rows.append(row)
        if len(self._rows) == CHUNK:
            self._pack()

    def to_bytes(self, note: Mapping[str, object]) -> bytes:
        """A Parquet file of the rows in their order, which says `note` of itself."""
        import pyarrow

        self._pack()
        return _written(pyarrow.Table.from_batches(self._packed, self.schema), note)

    def _pack(self) -> None:
        import pyarrow

        if self._rows:
            self._packed.append(pyarrow.RecordBatch.from_pylist(self._rows, self.schema))
            self._rows = []


def joined(files: Iterable[tuple[str, bytes]], note: Mapping[str, object]) -> bytes:
    """The rows of several files of `IndexTable` (name, content) as one. `InputError` where one is damaged or differs in
    its columns."""
    import pyarrow

    tables = [(place, _table(content, place, None)) for place, content in files]
    for place, table in tables:
        if table.schema != tables[0][1].schema:
            raise InputError(f"{place} and {tables[0][0]} are of different commands: give each an output folder")
    return _written(pyarrow.concat_tables([table for _, table in tables]), note)


def _written(table: "pyarrow.Table", note: Mapping[str, object]) -> bytes:
    import pyarrow.parquet

    table = table.sort_by(table.column_names[0]) if table.num_rows else table
    table = table.combine_chunks().replace_schema_metadata({NOTE: json.dumps(note).encode()})
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(table, sink, compression="zstd", row_group_size=2**16)
    return bytes(sink.getvalue())


def _table(content: bytes, place: str, wanted: Sequence[str] | None) -> "pyarrow.Table":
    import pyarrow.parquet

    try:
        file = pyarrow.parquet.ParquetFile(io.BytesIO(content))
        names = file.schema_arrow.names
        memory.refuse_above(file.metadata.num_rows * ROW_BYTES, place, "divide it, or raise --max-memory")
        chosen = names if wanted is None else [name for name in wanted if name in names]
        return file.read(chosen, use_threads=False).replace_schema_metadata(None)
    except (pyarrow.ArrowException, OSError, MemoryError, *WRONG) as error:
        raise InputError(f"{place} is not a Parquet file that can be read: give another one") from error
