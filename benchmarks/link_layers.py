"""Links between two layers without photographs, against known partners, under shifts and turns.

    python benchmarks/link_layers.py --root DATA > link_layers.json

`DATA/vectors.json` lists pairs of layers. Truth: polygons of the layers as they are whose centres are nearest to each
other within 10 m. The right layer is turned about the middle of the true pairs, then shifted, and linked as a file.
`--about layer` turns it about its own middle instead, which may lie kilometres from the common ground. Prints one JSON
document (schema zpm2-bench-link/1): a row for each shift and turn with precision, recall, and the error of the
estimated map at the true pairs.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import document
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import linking
from zpm2.config import Config
from zpm2.errors import Failed
from zpm2.formats import gis
from zpm2.linking.fit import nearest_pairs
from zpm2.linking.layer import in_meters, local_frame
from zpm2.linking.similarity import Similarity
from zpm2.photos.geolocation import between

SHIFTS = (0.0, 5.0, 10.0, 15.0)  # m
TURNS = (0.0, 1.0, 3.0, 5.0)  # degrees
REACH = 10.0  # m
DIRECTION = np.array([0.6, -0.8])


def rows_of(left_path: Path, right_path: Path, about: str, folder: Path) -> list[dict[str, Any]]:
    """A row for each shift and turn."""
    left, right = linking.open_layer(left_path), linking.open_layer(right_path)
    frame = local_frame(left)
    a, b = in_meters(left, frame), in_meters(right, frame)
    i, j = nearest_pairs(a.centers, b.centers, REACH)
    truth = set(zip(a.rows[i].tolist(), b.rows[j].tolist(), strict=True))
    middle = (b.centers[j] if about == "pairs" else b.centers).mean(0)
    rows = []
    for shift in SHIFTS:
        for turn in TURNS:
            change = Similarity(middle, shift * DIRECTION, turn)
            path = folder / "right.gpkg"
            shapes = shapely.transform(
                b.shapes, lambda points, change=change: between(frame, "EPSG:4326", change(points))
            )
            ids = np.arange(len(shapes))
            gis.write_file(path, "right", gis.Table({"row": ids}, {}), shapes, "EPSG:4326", "Unknown")
            start = process_time()
            result = linking.link(left, path, Config())
            seconds = process_time() - start
            found = {(each.left, int(b.rows[each.right])) for each in result.links}
            agreed = len(found & truth)
            row = {
                "shift": shift,
                "turn": turn,
                "links": len(found),
                "precision": round(agreed / max(len(found), 1), 4),
                "recall": round(agreed / len(truth), 4),
                "seconds": round(seconds, 2),
            }
            if not isinstance(result.similarity, Failed):
                off = result.similarity(a.centers[i]) - change(b.centers[j])
                row |= {"turn_found": round(result.similarity.turn, 4), "off": _length(np.median(off, axis=0))}
            rows.append(row)
            print(json.dumps(row), file=sys.stderr, flush=True)
    return rows


def _length(vector: NDArray[np.float64]) -> float:
    return round(float(np.hypot(*vector)), 3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--about", choices=("pairs", "layer"), default="pairs")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for pair in json.loads((options.root / "vectors.json").read_text()):
            paths = options.root / pair["left"], options.root / pair["right"]
            rows += [{"pair": pair["name"], **row} for row in rows_of(*paths, options.about, Path(folder))]
    print(document.text("zpm2-bench-link/1", about=options.about, rows=rows))


if __name__ == "__main__":
    main()
