"""The regions of the rendered pair as other tools would write their area matches."""

import json
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from rendered import Pair

from zpm2.formats.run_lengths import run_lengths
from zpm2.model import Mask


def labels(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    left, right = (np.array(PIL.Image.open(path)) for path in (pair.left_regions, pair.right_regions))
    return left, right


def objects(pair: Pair) -> list[int]:
    """Of the 12 largest regions that both images show."""
    left, right = labels(pair)
    both = np.intersect1d(left, right)
    return sorted(sorted((int(k) for k in both if k), key=lambda k: -int((left == k).sum()))[:12])


def dataset(pair: Pair, folder: Path, names: tuple[str, ...] = ("a/good",)) -> Path:
    """A data set of the rendered pair, as often as there are names."""
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / "disparity.png"), np.nan_to_num(pair.scene.disparity * 100).astype(np.uint16))
    truth = {"kind": "disparity", "file": "disparity.png", "scale": 100}
    entries = [{"name": name, "left": str(pair.left), "right": str(pair.right), "gt": truth} for name in names]
    (folder / "pairs.json").write_text(json.dumps(entries))
    return folder


def rle(bits: np.ndarray) -> dict:
    height, width = bits.shape
    counts = run_lengths(Mask(0, 0, bits), width, height).tolist()
    return {"size": [height, width], "counts": counts}


def box(bits: np.ndarray) -> list[int]:
    rows, columns = np.flatnonzero(bits.any(1)), np.flatnonzero(bits.any(0))
    return [int(v) for v in (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)]


def neutral(pair: Pair, folder: Path, name: str = "a/good") -> Path:
    """As run lengths on the left and as a mask file on the right."""
    left, right = labels(pair)
    file = folder / f"{name}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    PIL.Image.fromarray(right).save(file.parent / "right.png")
    matches = [
        {"left": {"rle": rle(left == k)}, "right": {"mask": "right.png", "value": k}, "score": 0.5}
        for k in objects(pair)
    ]
    file.write_text(json.dumps({"schema": "zpm2-area-matches/1", "seconds": 1.5, "matches": matches}))
    return file
