"""All results below a folder (an evaluation, or pairs matched one after the other) as one page, the worst first."""

import csv
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np

from zpm2.errors import InputError, Zpm2Error
from zpm2.evaluate.predictions import PREDICTIONS
from zpm2.evaluate.report import harmless
from zpm2.files.reading import WRONG, read_json
from zpm2.files.writing import atomic_write, claim
from zpm2.formats.saving import DOCUMENT, REPORT
from zpm2.result import save_report
from zpm2.view.report.pairs import Column, Row, page

FILE, ROWS, PICTURE = "index.html", "rows.csv", "overlay.png"
THUMBNAIL = 480  # px, the longer side; shown at half of it
QUALITY = 70  # 1..100, WebP
MATCHED = (
    Column("matches", "Matches", "number of matches"),
    Column("unmatched", "Not matched", "polygons without a partner, of both photographs"),
    Column("confidence", "Mean conf.", "mean confidence of the matches", 2),
    Column("same_scene", "Same scene", "probability that both photographs show the same scene", 2),
    Column("seconds", "Seconds", "time of the run", 1),
)
SCORED = (
    Column("F1", "F1", "harmonic mean of precision and recall", 3),
    Column("P", "Precision", "share of the matches that are right", 3),
    Column("R", "Recall", "share of the true pairs that were found", 3),
    Column("good", "Right", "matches that are right"),
    Column("scored", "Scored", "matches of which the truth is known"),
    Column("error_R", "R error, °", "error of the rotation, degrees", 2),
    Column("error_t", "t error, °", "error of the direction of the translation, degrees", 2),
)


def found_below(folder: Path) -> list[Path]:
    """The folders below one that hold a result, its report, or why there is none (failed.json); sorted, without hidden
    ones."""
    found = []
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if Path(place) != folder and {DOCUMENT, REPORT, "failed.json"} & set(names):
            found.append(Path(place))
    return sorted(found)


def save_overview(folder: Path, reports: int, tell: Callable[[str], None] = lambda text: None) -> Path:
    """Writes index.html into a folder: a table of all results below it. Returns its path.

    Scores are those of rows.csv, where there is one. The worst pairs come first: those that failed, then by F1, then by
    mean confidence. The first `reports` of them get a report where they have none. `InputError` where nothing is found,
    `OutputError` where the folder cannot be written into.
    """
    places = found_below(folder)
    if not places:
        raise InputError(f"{folder} holds no result, nor does a folder below it")
    claim(folder, [FILE])
    scores = _scores(folder / ROWS)
    top = folder / PREDICTIONS if (folder / PREDICTIONS).is_dir() else folder
    rows = [_row(place, _name(place, top, folder), scores, folder) for place in places]
    columns = [column for column in (*SCORED, *MATCHED) if any(row.values.get(column.name) is not None for row in rows)]
    order = sorted(zip(rows, places, strict=True), key=lambda each: _badness(each[0]))
    shown = []
    for k, (row, place) in enumerate(order):
        shown.append(_linked(row, place, folder, k < reports, tell))
    title = folder.resolve().name
    return atomic_write(folder / FILE, page(title, f"{len(rows)} pairs, the worst first", columns, shown))


def _name(place: Path, top: Path, folder: Path) -> str:
    return place.relative_to(top if place.is_relative_to(top) else folder).as_posix()


def _scores(file: Path) -> Mapping[str, Mapping[str, str]]:
    """The rows of rows.csv by pair, as `harmless` writes it; `InputError` where it is damaged."""
    if not file.is_file():
        return {}
    try:
        with file.open(encoding="utf-8", newline="") as text:
            return {row["pair"]: row for row in csv.DictReader(text) if row.get("pair")}
    except (*WRONG, OSError, csv.Error) as error:
        raise InputError(f"{file} cannot be read ({error}): run zpm2 eval again, or remove it") from error


def _row(place: Path, name: str, scores: Mapping[str, Mapping[str, str]], folder: Path) -> Row:
    score = scores.get(str(harmless(name)), {})
    values: dict[str, float | None] = {column.name: _number(score.get(column.name)) for column in SCORED}
    remark = ""
    try:
        if (place / DOCUMENT).is_file():
            values |= _of_document(place / DOCUMENT)
        elif not (place / REPORT).is_file():
            remark = f"failed: {read_json(place / 'failed.json')['reason']}"
    except (*WRONG, OSError) as error:
        remark = f"{place.relative_to(folder).as_posix()} cannot be read: {error}"
    return Row(name, None, remark, _thumbnail(place / PICTURE), values)


def _of_document(file: Path) -> dict[str, float | None]:
    document = read_json(file)
    matches = document["matches"]
    polygons = sum(len(document[side]["polygons"]) for side in ("left", "right"))
    same = document.get("same_scene")
    return {
        "matches": len(matches),
        "unmatched": polygons - 2 * len(matches),
        "confidence": sum(float(m["confidence"]) for m in matches) / len(matches) if matches else None,
        "same_scene": None if same is None else float(same),
        "seconds": float(sum(document["timings"].values())),
    }


def _badness(row: Row) -> tuple[bool, float, float, str]:
    """A key that puts the worst pairs first."""
    score, confidence = row.values.get("F1"), row.values.get("confidence")
    return not row.remark, 2.0 if score is None else score, 0.0 if confidence is None else confidence, row.name


def _linked(row: Row, place: Path, folder: Path, wanted: bool, tell: Callable[[str], None]) -> Row:
    """The row with a link to its report, which is made if it is wanted and missing."""
    link, remark = None, row.remark
    if wanted and (place / DOCUMENT).is_file() and not (place / REPORT).is_file():
        try:
            tell(row.name)
            save_report(place)
        except Zpm2Error as error:
            remark = f"no report: {error}"
    if (place / REPORT).is_file():
        link = (place / REPORT).relative_to(folder).as_posix()
    return Row(row.name, link and _address(link), remark, row.thumbnail, row.values)


def _address(path: str) -> str:
    return "./" + quote(path)


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _thumbnail(file: Path) -> bytes | None:
    """The overlay of a pair, small; None where there is none."""
    if not file.is_file():
        return None
    pixels = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        return None
    factor = min(1.0, THUMBNAIL / max(pixels.shape))
    size = max(1, round(pixels.shape[1] * factor)), max(1, round(pixels.shape[0] * factor))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes())
