"""Lists of pairs, and what a batch reads of an earlier run."""

import io
import json
from pathlib import Path

import pyarrow
import pyarrow.parquet
from samples import Files, Reader, only

from zpm2.batch import read_groups, read_index, read_pairs
from zpm2.batch.results import LocalResults
from zpm2.batch.tables import IndexTable, joined, read_note

CSV = b'name,left,right,regions,K\na_b,"l, 1.png",r.png,,"1,2,3,4"\n,l2.png,r.png,x.geojson,\n'
GROUPS = b'photograph,group\n"l, 1.png",a\nr.png,b\nl2.png,a\n'


def batch_readers() -> list[Reader]:
    """All of them."""
    names = ["name", "left", "right", "K"]
    table = io.BytesIO()
    rows = [[f"{name}{k}" for k in range(20)] for name in names]
    pyarrow.parquet.write_table(pyarrow.table(dict(zip(names, rows, strict=True))), table)
    row = {"schema": "zpm2-batch-pair/1", "key": "k", "pair": "a", "status": "done", "reason": None, "seconds": 1.5}
    lists: tuple[Files, ...] = ({"a.csv": CSV}, {"a.parquet": table.getvalue()})
    return [
        Reader("list of pairs", lists, lambda folder: read_pairs(only(folder))),
        Reader("list of groups", ({"a.csv": GROUPS},), lambda folder: read_groups(only(folder))),
        Reader("index of a batch", ({"index.parquet": _index()},), _read_index),
        Reader("row of a pair", ({"pairs/a/pair.json": json.dumps({**row, "found": {"n": 1}}).encode()},), _row),
    ]


def _index() -> bytes:
    index = IndexTable({"row": "int", "pair": "text", "seconds": "float", "rotation": "floats"})
    for k in range(20):
        index.add({"row": k, "pair": f"a{k}", "seconds": 0.5 * k, "rotation": [1.0, 0.0]})
    return index.to_bytes({"complete": True})


def _read_index(folder: Path) -> None:
    read_index(folder)
    content = only(folder).read_bytes()
    read_note(content, "index.parquet")
    joined([("index.parquet", content)], {})


def _row(folder: Path) -> None:
    found = LocalResults(folder).row("a", "k")
    if found is not None:
        found.document("k", "pair")
