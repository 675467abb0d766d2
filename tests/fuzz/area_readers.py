"""Area matches of other tools, as readers: one of each format that is registered."""

import json
from pathlib import Path

import numpy as np
from mutate import SIZE
from samples import Files, Reader, encoded

from zpm2.evaluate.results.areas import sized_pair
from zpm2.evaluate.results.registry import RESULTS

PAIR = sized_pair("a", (SIZE, SIZE))
BITS = np.kron(np.array([[0, 1, 1, 0]], np.uint8), np.ones((SIZE[1], SIZE[0] // 4), np.uint8))


def area_readers() -> list[Reader]:
    """All of them."""
    return [_reader(name, *samples) for name, samples in _samples().items()]


def _reader(name: str, *samples: Files) -> Reader:
    def read(folder: Path) -> None:
        RESULTS.get(name).read(folder, PAIR)

    return Reader(f"areas of other tools: {name}", samples, read)


def _samples() -> dict[str, tuple[Files, ...]]:
    ring = [[5, 5], [30, 5], [30, 20], [5, 20]]
    runs = {"size": [SIZE[1], SIZE[0]], "counts": [480, 960, 480]}
    matches = [
        {"left": {"box": [0, 0, 20, 20]}, "right": {"polygon": [ring]}, "score": 0.5},
        {"left": {"rle": runs}, "right": {"mask": "right.png"}, "score": 1.0},
    ]
    neutral = {
        "schema": "zpm2-area-matches/1",
        "matches": matches,
        "left_areas": [{"box": [1, 1, 5, 5]}],
        "seconds": 1.5,
    }
    frame = {"bboxes": [[0, 0, 20, 20]], "scores": [0.5], "instances_id": [3], "masks": [BITS.tolist()]}
    track = [{"image_id": k, "track_id": 7, "bbox": [1, 2, 20, 20], "score": 0.5} for k in (1, 2)]
    picture = encoded("PNG", BITS)
    return {
        "areas": ({"a.json": json.dumps(neutral).encode(), "right.png": picture},),
        "masa": ({"a.json": json.dumps([frame, frame]).encode()}, {"a.json": json.dumps(track).encode()}),
        "sam2": (
            {"a/00000.png": picture, "a/00001.png": picture},
            {"a/001/00000.png": picture, "a/001/00001.png": picture},
        ),
    }
