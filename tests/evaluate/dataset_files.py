"""Writers of tiny data sets in their publishers' layouts, and where the real samples lie."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import EvalPair

SAMPLES = Path(__file__).resolve().parents[3] / "shared" / "data"


def sample(path: str) -> Path:
    """A file or folder of the real samples; skips the test where it is not there."""
    found = SAMPLES / path
    if not found.exists():
        pytest.skip(f"needs the real sample {path} in the folder of shared data beside the repository")
    return found


def listed(name: str, root: Path, split: str | None = None, **options: object) -> list[EvalPair]:
    return list(open_dataset(name, root, split, **options).pairs())


def picture(path: Path, width: int = 8, height: int = 6) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.zeros((height, width, 3), np.uint8))
    return path


def file(path: Path, content: str | bytes = b"") -> Path:
    """A file that a loader must not open, or one of text."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def files(root: Path, *names: str) -> None:
    for name in names:
        file(root / name)


def numbers(matrix: object) -> str:
    return "\n".join(" ".join(repr(float(value)) for value in row) for row in np.atleast_2d(matrix))
