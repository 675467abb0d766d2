"""What `zpm2 app` reads: photographs that a browser sends, and results."""

import json
from pathlib import Path

from samples import Files, Reader, encoded, pixels

from zpm2.app.photograph import received
from zpm2.app.session import made
from zpm2.config import preset


def app_readers() -> list[Reader]:
    """All of them."""
    sent: tuple[Files, ...] = (
        {"a": encoded("PNG", pixels())},
        {"a": encoded("JPEG", pixels())},
        {"a": encoded("TIFF", pixels(1, "u2"))},
    )
    ring = [[5.0, 5.0], [30.0, 5.0], [30.0, 20.0], [5.0, 20.0]]
    polygon = {"id": 1, "vertices": ring, "holes": [], "area": 375.0, "score": 0.9, "parent": None, "label": "<a>"}
    side = {"path": "a.png", "relative_path": "a.png", "content": None, "width": 48, "height": 40, "crs": None}
    side |= {"transform": None, "gsd": None, "rpc": None, "polygons": [polygon]}
    match = {"left": 1, "right": 1, "confidence": 0.5, "cost": 0.1, "dsf": 2, "stage": "local", "overlap": 0.5}
    document = {
        "schema": "zpm2-matches/1",
        "left": side,
        "right": side,
        "matches": [{**match, "nodes": []}],
        "points": {"left": [], "right": [], "score": []},
        "fundamental": None,
        "homography": None,
        "config": {},
        "timings": {},
        "warnings": [],
        "version": "0",
    }
    result: Files = {"matches.json": json.dumps(document).encode(), "a.png": encoded("PNG", pixels())}

    def opened(folder: Path) -> None:
        session = made(preset("default"), lambda text: None)
        session.open_result(folder)
        session.describe()

    return [
        Reader(
            "photograph that a browser sends",
            sent,
            lambda folder: received(folder / "a", "a", "left", preset("default")),
        ),
        Reader("result that zpm2 app opens", (result,), opened),
    ]
