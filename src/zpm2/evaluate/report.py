"""From predictions to rows, and from rows to tables. Needs no models."""

import csv
import dataclasses
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from zpm2.config import Config
from zpm2.errors import Failed, InputError
from zpm2.evaluate import predictions
from zpm2.evaluate.metrics import IOU_THRESHOLDS, Scores, score_centers, scores
from zpm2.evaluate.pairs import Array, EvalPair, PoseTruth, Truth
from zpm2.evaluate.pose_error import pose_auc, pose_error
from zpm2.evaluate.published import POSE
from zpm2.evaluate.tables import TABLES, here
from zpm2.files.writing import atomic_write, claim
from zpm2.formats.parquet import require_pyarrow
from zpm2.model import Camera
from zpm2.pose import PoseFinder
from zpm2.result import MatchResult

COUNTS = ("good", "scored", "unscored", "gt")
SHARES = ("MAS", "P", "R", "F1", "ACR", "AOR", "CCR", "CCR5")  # of `Scores.to_dict`, means are taken over pairs
PAPER = ("P", "R", "F1", "ACR")  # by the paper's ground truth too
Cell = str | float | None
Row = dict[str, Cell]  # the figures of one pair by name; a pair lacks those that it cannot have

_FORMULA = re.compile(r"\s*[=+@\uff1d\uff0b\uff0d\uff20-]|[\t\r\n]")  # how one begins, in wide letters too


def row(pair: EvalPair, out: Path) -> Row:
    """All figures of the prediction of one pair. `status` is "ok", "missing", or the reason why there are fewer.

    Dense truth: the figures of `Scores` at 0.5, MAS at 0.4, 0.5 and 0.8, and P_paper, R_paper and ACR_paper by the
    paper's ground truth of projected centres. Pose truth (RGB-D pairs too): errors of R and t in degrees, of the pose
    that was predicted, and (`_points`) of the one that the homologous points give without any polygon, by the same
    estimator.
    """
    result = predictions.load(pair, out)
    if not isinstance(result, MatchResult):
        return {"pair": pair.name, "status": result or "missing"}
    values = _counts(pair, result)
    values |= {"seconds": sum(result.timings.values()), "peak_mb": predictions.memory(pair, out)}
    if isinstance(pair.truth, PoseTruth):
        values |= _pose(result, predictions.load_pose(pair, out), pair.truth)
    return _with_dense(values, result, pair)


def row_of_areas(pair: EvalPair, result: MatchResult) -> Row:
    """The figures of another tool's areas: those of `row` that need dense truth. Seconds are the tool's own, where it
    says them."""
    values = _counts(pair, result)
    values |= {"seconds": sum(result.timings.values()) if result.timings else None, "peak_mb": None}
    if pair.truth is None or type(pair.truth) is PoseTruth:
        values["status"] = "no truth: areas are judged by disparity, depth or a homography, which this pair has not"
    return _with_dense(values, result, pair)


def _counts(pair: EvalPair, result: MatchResult) -> Row:
    values: Row = {"pair": pair.name, "status": "ok"}
    values |= {"left": len(result.left.polygons), "right": len(result.right.polygons)}
    values |= {"matches": len(result.matches), "points": len(result.points)}
    return values | {f"s_{stage}": seconds for stage, seconds in result.timings.items()}


def _with_dense(values: Row, result: MatchResult, pair: EvalPair) -> Row:
    if pair.truth is not None and type(pair.truth) is not PoseTruth:
        try:
            values |= _dense(result, pair.truth)
        except InputError as error:
            values["status"] = f"no truth: {error}"
    return values


def _dense(result: MatchResult, truth: Truth) -> Row:
    by_threshold = {s.iou: _known_ratios(s) for s in scores(result, truth)}
    middle = by_threshold[0.5]
    figures: Row = {name: middle[name] for name in (*COUNTS, *SHARES)}
    figures |= {f"MAS{round(100 * t)}": by_threshold[t]["MAS"] for t in IOU_THRESHOLDS}
    centers = _known_ratios(score_centers(result, truth))
    return figures | {f"{name}_paper": centers[name] for name in PAPER}


def _known_ratios(found: Scores) -> dict[str, float | None]:
    """The scores by name; no ACR where nothing is true, as it is a ratio to that."""
    return found.to_dict() | ({} if found.gt else {"ACR": None})


def _pose(result: MatchResult, predicted: predictions.PredictedPose | None, truth: PoseTruth) -> Row:
    config = Config.from_dict({k: v for k, v in result.config.items() if k in ("pose", "points", "seed")})
    found = PoseFinder(without_polygons(config))(result, cameras_of(result, truth))
    pose = found.pose
    errors = _pose_errors(None if isinstance(pose, Failed) else (pose.rotation, pose.translation), truth)
    figures: Row = {"error_R_points": errors[0], "error_t_points": errors[1]}
    if predicted is not None:
        errors = _pose_errors(predicted.motion, truth)
        figures |= {"error_R": errors[0], "error_t": errors[1]}
        figures |= {"pose_points": predicted.used, "pose_inliers": predicted.inliers}
        figures |= {"pose_flags": predicted.flags, "s_pose": predicted.seconds}
    return figures


def _pose_errors(motion: tuple[Array, Array | None] | None, truth: PoseTruth) -> tuple[float, float]:
    """Degrees of R and t; infinity where there is no pose, or no translation although the cameras moved."""
    return (float("inf"), float("inf")) if motion is None else pose_error(*motion, truth.pose)


def without_polygons(config: Config) -> Config:
    """The same estimator on all homologous points as they are."""
    return dataclasses.replace(config, pose=dataclasses.replace(config.pose, points="all", crops="off", bucket=0))


def cameras_of(result: MatchResult, truth: PoseTruth) -> tuple[Camera, Camera]:
    """The cameras of a pair with a known pose."""
    left, right = truth.intrinsics
    return Camera(left, (result.left.width, result.left.height)), Camera(
        right, (result.right.width, result.right.height)
    )


def summary(rows: Sequence[Row]) -> dict[str, float | None]:
    """Sums, means over pairs and AUC of the pairs that have them. Failed pairs are counted, not averaged."""
    done = [r for r in rows if "matches" in r]
    dense = [r for r in done if "MAS" in r]
    found: dict[str, float | None] = {
        "pairs": len(rows),
        "done": len(done),
        "problems": sum(r["status"] != "ok" for r in rows),
        "matches": _mean(done, "matches"),
        "seconds": _mean(done, "seconds"),
        "peak_mb": max((mb for mb in _numbers(done, "peak_mb") if mb), default=None),
        "dense": len(dense),
    }
    found |= {name: sum(_numbers(dense, name)) for name in COUNTS if dense}
    names = (*(f"MAS{round(100 * t)}" for t in IOU_THRESHOLDS), *SHARES[1:], *(f"{name}_paper" for name in PAPER))
    found |= {name: _mean(dense, name) for name in names if dense}
    found |= {name: _mean(done, name) for name in _stages(done)}
    for kind in ("", "_points"):
        posed = [r for r in done if f"error_R{kind}" in r]
        if posed:
            errors = zip(_numbers(posed, f"error_R{kind}"), _numbers(posed, f"error_t{kind}"), strict=True)
            auc = pose_auc(list(errors))
            found[f"posed{kind}"] = len(posed)
            found |= {f"AUC{t}{kind}": value for t, value in zip((5, 10, 20), auc, strict=True)}
    return found


def known(total: Mapping[str, float | None]) -> dict[str, float]:
    """The figures of a summary that there are."""
    return {name: value for name, value in total.items() if value is not None}


def pose_table(rows: Sequence[Row]) -> str:
    """AUC of the pose with and without polygons beside the rows that the paper prints for ScanNet1500."""
    total = known(summary(rows))
    ours: list[list[Cell]] = [
        [name, *(100 * total[f"AUC{t}{kind}"] for t in (5, 10, 20)), f"measured, {total[f'posed{kind}']} pairs"]
        for name, kind in (("zpm2", ""), ("zpm2, all points, no polygons", "_points"))
        if f"posed{kind}" in total
    ]
    printed: list[list[Cell]] = [
        [*row, f"published, not measured here (--table 6, {here(TABLES[6], row.method)})"] for row in POSE
    ]
    return table(["method", "AUC@5", "AUC@10", "AUC@20", "source"], [*printed, *ours])


def markdown(title: str, rows: Sequence[Row], made_by: str, beside: str = "") -> str:
    """The summary and the pairs as tables, and `beside` them a table of published rows."""
    total = summary(rows)
    parts = [f"# {title}", f"Made by `{made_by}`.", _summary_table(total)]
    if beside:
        parts += ["## Beside published rows", beside]
    problems = [f"- {_cell(r['pair'])}: {_cell(r['status'])}" for r in rows if r["status"] != "ok"]
    if problems:
        parts += ["## Problems", "\n".join(problems)]
    columns = ["pair", "left", "right", "matches", "good", "scored", "gt", "MAS", "P", "R", "CCR", "CCR5"]
    columns += ["error_R", "error_t", "error_R_points", "error_t_points", "pose_flags", "seconds", "peak_mb"]
    columns = [c for c in columns if any(c in r for r in rows)]
    parts += ["## Pairs", table(columns, [[r.get(c) for c in columns] for r in rows])]
    return "\n\n".join(parts) + "\n"


def _summary_table(total: Mapping[str, float | None]) -> str:
    shown = known(total)
    shares = {name for name in shown if name.startswith(("MAS", "AUC")) or name.removesuffix("_paper") in SHARES}
    cells = [f"{100 * v:.2f} %" if name in shares else _cell(v) for name, v in shown.items()]
    return table(["figure", "value"], [[name, cell] for name, cell in zip(shown, cells, strict=True)])


def table(columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "| --- |" + " ---: |" * (len(columns) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(_cell(value) for value in values) + " |" for values in rows)])


def names(parquet: bool) -> list[str]:
    """The files that `write` writes."""
    return ["rows.csv", "summary.json", "summary.md", *(["rows.parquet"] if parquet else [])]


def write(title: str, rows: Sequence[Row], out: Path, made_by: str, parquet: bool = False, beside: str = "") -> None:
    """rows.csv (and rows.parquet), summary.json and summary.md, each whole or not at all."""
    claim(out, names(parquet))
    columns = list(dict.fromkeys(name for r in rows for name in r))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns)
    writer.writeheader()
    writer.writerows({name: harmless(value) for name, value in r.items()} for r in rows)
    atomic_write(out / "rows.csv", text.getvalue())
    atomic_write(out / "summary.json", json.dumps({"title": title, "made_by": made_by, **summary(rows)}, indent=1))
    atomic_write(out / "summary.md", markdown(title, rows, made_by, beside))
    if parquet:
        atomic_write(out / "rows.parquet", _parquet(columns, rows))


def require_parquet() -> ModuleType:
    """pyarrow, or `MissingDependency` where Parquet cannot be written."""
    return require_pyarrow("--parquet")


def collect(pairs: Iterable[EvalPair], out: Path, tell: Callable[[str], None]) -> list[Row]:
    """The rows of all pairs, one result in memory at a time."""
    rows = []
    for pair in pairs:
        rows.append(row(pair, out))
        tell(pair.name)
    return rows


def _parquet(columns: Sequence[str], rows: Sequence[Row]) -> bytes:
    pyarrow = require_parquet()
    sink = pyarrow.BufferOutputStream()
    content = pyarrow.table({name: [r.get(name) for r in rows] for name in columns})
    pyarrow.parquet.write_table(content, sink)
    return bytes(sink.getvalue())


def _stages(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for r in rows for name in r if name.startswith("s_")))


def _mean(rows: Sequence[Row], name: str) -> float | None:
    """Over the rows that have it."""
    values = _numbers(rows, name)
    return float(np.mean(values)) if values else None


def _numbers(rows: Sequence[Row], name: str) -> list[float]:
    """The numbers of the rows that have one under this name."""
    return [value for r in rows if isinstance(value := r.get(name), int | float)]


def _cell(value: Cell) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"
    return " ".join(str(value).split()).replace("|", "\\|").replace("<", "&lt;")


def harmless(value: Cell) -> Cell:
    """A cell of a CSV file: a text, such as a name, that a spreadsheet would take for a formula begins with '."""
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value
