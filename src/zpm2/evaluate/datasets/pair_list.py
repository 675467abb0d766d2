"""A folder with `pairs.json` or with a CSV of pairs: how users bring their own. Schema: docs/datasets.md."""

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path

from zpm2.errors import ConfigError, InputError, did_you_mean
from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import DepthTruth, DisparityTruth, EvalPair, HomographyTruth, PoseTruth, Truth
from zpm2.files.listing import existing, json_file, text
from zpm2.formats import cameras
from zpm2.formats.convert import Members

KINDS = ("disparity", "depth", "pose", "homography")


@dataset("pairs", truth="as listed")
def from_json(root: Path, split: str | None) -> Iterator[EvalPair]:
    """The pairs of `pairs.json`, in its order. split: one value of "set"; None for all."""
    path = root / "pairs.json"
    entries = json_file(path)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{path} must hold a list of objects, one for each pair: correct the file")
    if split is not None:
        sets = list(dict.fromkeys(str(entry["set"]) for entry in entries if "set" in entry))
        if split not in sets:
            raise ConfigError(f"{path} has no set '{split}'{did_you_mean(split, sets)}; sets are: {', '.join(sets)}")
        entries = [entry for entry in entries if "set" in entry and str(entry["set"]) == split]
    return found((_entry(root, entry, f"pair {k} of {path}") for k, entry in enumerate(entries)), f"pairs in {path}")


@dataset("csv", truth="disparity or none")
def from_csv(root: Path, split: str | None) -> Iterator[EvalPair]:
    """The rows of `pairs.csv` (split: of `SPLIT.csv`), in its order: left, right[, disparity, scale, sign, name]."""
    path = root / f"{split or 'pairs'}.csv"
    table = csv.DictReader(io.StringIO(text(path), newline=""), skipinitialspace=True)
    known = ("left", "right", "disparity", "scale", "sign", "name")
    try:
        columns, rows = table.fieldnames or (), [(table.line_num, row) for row in table]
    except csv.Error as error:  # a cell without end, most of all
        raise InputError(f"{path} is not a table of pairs, line {table.line_num}: {error}") from error
    if not {"left", "right"} <= set(columns) or not set(columns) <= set(known):
        raise InputError(f"{path} has the columns {','.join(columns)}: write left,right[,disparity,scale,sign,name]")
    return found((_row(root, row, f"{path} line {number}") for number, row in rows), f"rows in {path}")


def _entry(root: Path, entry: Members, what: str) -> EvalPair:
    for key in ("name", "left", "right"):
        if not isinstance(entry.get(key), str) or not entry[key]:
            raise InputError(f"{what} has no '{key}': write it as a string")
    what = f"pair '{entry['name']}' of {root / 'pairs.json'}"
    name = path_name(*entry["name"].split("/"))
    return EvalPair(name, existing(root / entry["left"]), existing(root / entry["right"]), _truth(root, entry, what))


def _truth(root: Path, entry: Members, what: str) -> Truth | None:
    truth = entry.get("gt")
    if truth is None:
        return None
    kind = truth.get("kind") if isinstance(truth, dict) else None
    if kind == "disparity":
        file, scale = _file(root, truth, "file", what), _scale(truth.get("scale", 1), what)
        return DisparityTruth(file, scale, _sign(truth.get("sign", 1), what))
    if kind == "homography":
        return HomographyTruth(cameras.homography(cameras.matrix(truth.get("H"), (3, 3), f"H of {what}")))
    if kind not in KINDS:
        raise InputError(f"{what} has a gt of kind {kind!r}: write null or one of {', '.join(KINDS)}")
    k0, k1 = (cameras.intrinsics(cameras.calibration(truth.get(key), f"{key} of {what}")) for key in ("K0", "K1"))
    pose = cameras.rigid(truth.get("T_0to1"), f"T_0to1 of {what}")
    if kind == "pose":
        return PoseTruth((k0, k1), pose)
    right = None if truth.get("file1") is None else _file(root, truth, "file1", what)
    return DepthTruth((k0, k1), pose, (_file(root, truth, "file", what), right), _scale(truth.get("scale", 1000), what))


def _row(root: Path, row: dict[str, str | None], what: str) -> EvalPair:
    if not row["left"] or not row["right"] or None in row:
        raise InputError(f"{what} does not fit the columns: write a left and a right file, paths with commas in quotes")
    left, right = existing(root / row["left"]), existing(root / row["right"])
    name = row.get("name") or f"{(Path(row['left']).parent / left.stem).as_posix()}-{right.stem}"
    disparity = row.get("disparity")
    truth = None
    if disparity:
        scale, sign = _scale(row.get("scale") or 1, what), _sign(row.get("sign") or 1, what)
        truth = DisparityTruth(existing(root / disparity), scale, sign)
    return EvalPair(path_name(*name.split("/")), left, right, truth)


def _file(root: Path, truth: Members, key: str, what: str) -> Path:
    if not isinstance(truth.get(key), str):
        raise InputError(f"gt of {what} has no '{key}': write the path of its map")
    return existing(root / truth[key])


def _scale(value: float | str, what: str) -> float:
    try:
        scale = float(value)
    except (TypeError, ValueError):
        scale = math.nan
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(f"{what} has the scale {value!r}: write a number above 0")
    return scale


def _sign(value: object, what: str) -> int:
    if str(value) not in ("1", "-1"):
        raise InputError(f"{what} has the sign {value!r}: write 1, or -1 where the file stores -d")
    return int(str(value))
