"""What readers are made of: a function, and small valid files."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
from mutate import SIZE

Files = dict[str, bytes]


@dataclass(frozen=True)
class Reader:
    """A function of a folder, and folders that it reads: files by name, the first of each is damaged most."""

    name: str
    samples: tuple[Files, ...]
    read: Callable[[Path], Any]
    still: frozenset[str] = frozenset()  # names of files that stay as they are


def pixels(bands: int = 3, kind: str = "u1") -> Any:
    rng = np.random.default_rng(0)
    values = rng.integers(0, 255 if kind == "u1" else 4000, (SIZE[1], SIZE[0], bands)).astype(kind)
    return values[..., 0] if bands == 1 else values


def encoded(kind: str, pixels: Any, **options: Any) -> bytes:
    out = io.BytesIO()
    PIL.Image.fromarray(pixels).save(out, kind, **options)
    return out.getvalue()


def npy(values: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, values)
    return out.getvalue()


def npz(values: dict[str, Any]) -> bytes:
    out = io.BytesIO()
    np.savez(out, **values)
    return out.getvalue()


def only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path
