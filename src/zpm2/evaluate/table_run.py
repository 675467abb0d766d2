"""A table of the paper by one call: each line that can be run, beside the published rows."""

import dataclasses
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path

from zpm2 import config as configuration
from zpm2.errors import ConfigError, Zpm2Error
from zpm2.evaluate import report
from zpm2.evaluate.report import Cell
from zpm2.evaluate.run import Evaluation
from zpm2.evaluate.tables import TABLES, Line, Table, here
from zpm2.files.record import make_folder
from zpm2.files.writing import atomic_write, claim

Summary = Mapping[str, float | None]  # see `report.summary`
NAMES = {"sceneflow": "SceneFlow", "kitti": "KITTI", "scannet": "ScanNet"}  # how the paper's rows call data sets


def run_table(
    evaluation: Evaluation, number: int, out: str | Path, tell: Callable[[str], None] = lambda text: None
) -> str:
    """Table `number` of the paper on a data set, as Markdown; `out` gets it as table.md and table.json, and a folder
    with the evaluation of each line, so that an interrupted run goes on.

    The configuration of `evaluation` is that of all lines, each with its own settings over it. A line that cannot be
    run, as weights or packages are missing, says why. `ConfigError` for a table that the paper does not have.
    """
    if number not in TABLES:
        raise ConfigError(f"the paper has no table {number}: its tables are {', '.join(map(str, TABLES))}")
    folder, table = Path(out), TABLES[number]
    evaluation.pairs()  # a data set that cannot be read is no matter of a line
    claim(folder, file_names(number))
    runs: dict[str, Summary | str] = {}
    for line in table.lines:
        if not line.run:
            runs[line.label] = _measured(evaluation, line, folder, tell)
    lines = [_published(table, row) for row in _printed(table, evaluation.dataset)]
    lines += [_line(table, line, runs[line.run or line.label]) for line in table.lines]
    columns = ["method", *table.columns, "source"]
    text = report.table(columns, lines)
    document = {"table": number, "title": table.title, "dataset": evaluation.dataset}
    rows = [dict(zip(columns, cells, strict=True)) for cells in lines]
    atomic_write(folder / "table.json", json.dumps({**document, "rows": rows}, indent=1, ensure_ascii=False))
    atomic_write(folder / "table.md", f"# Table {number}: {table.title}, {evaluation.dataset}\n\n{text}\n")
    return text


def file_names(number: int) -> list[str]:
    """The files and folders that `run_table` may write."""
    return ["table.json", "table.md", *(_folder(line.label) for line in TABLES[number].lines if not line.run)]


def _folder(label: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")


def _measured(evaluation: Evaluation, line: Line, out: Path, tell: Callable[[str], None]) -> Summary | str:
    """The summary of a line's evaluation, or why there is none."""
    try:
        changed = dataclasses.replace(
            evaluation,
            method=line.method,
            config=configuration.assign(evaluation.config, line.settings),
            regions=out / _folder(line.regions) if line.regions else evaluation.regions,
        )
        home = out / _folder(line.label)
        make_folder(home)
        rows = changed.run(home, title=line.label, tell=lambda text: tell(f"{line.label}: {text}"))
    except Zpm2Error as error:
        tell(f"{line.label}: {error}")
        return str(error)
    return report.summary(rows)


def _printed(table: Table, dataset: str) -> list[tuple[Cell, ...]]:
    """The published rows of a data set; all of them where the paper has none of it."""
    names = [name for key, name in NAMES.items() if dataset.startswith(key)]
    own = [row for row in table.printed if row[0] in ("", *names)]
    if own:
        return [row[1:] for row in own]
    return [(f"{row[1]}, {row[0]}", *row[2:]) for row in table.printed]


def _published(table: Table, row: tuple[Cell, ...]) -> list[Cell]:
    return [*row, f"published; {here(table, str(row[0]))}"]


def _line(table: Table, line: Line, measured: Summary | str) -> list[Cell]:
    if isinstance(measured, str):
        return [line.label, *(None for _ in table.columns), f"not run: {measured}"]
    cells: list[Cell] = []
    for column, usual in table.columns.items():
        key = line.keys.get(column, usual)
        value = measured.get(key.removesuffix("%"))
        cells.append(100 * value if value is not None and key.endswith("%") else value)
    return [line.label, *cells, f"measured, {measured['done']} of {measured['pairs']} pairs"]
