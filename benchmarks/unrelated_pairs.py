"""How well pairs of one scene are told from pairs of two: evidence of the epipolar geometry, a contrario.

    python benchmarks/unrelated_pairs.py --root DATA [--root MORE ...] --points FOLDER [--most 300]

Points alone, found once and kept in FOLDER. Pairs of one scene are those of every pairs.json; pairs of two are the left
photograph of one set and the right one of another, drawn at random, and what FOLDER holds of an earlier run. `limit` is
where the two are farthest from each other in the other sets (one set left out at a time, with all pairs that it is part
of), and `wrong` how many pairs of this set that limit puts on the wrong side. Prints tables to stderr and one JSON
document (schema zpm2-bench-chance/2) to stdout.
"""

import argparse
import json
import random
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import document
from known_points import KnownPoints, pairs_of

from zpm2 import config
from zpm2.global_match import initial_geometry


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True, action="append")
    parser.add_argument("--points", type=Path, required=True)
    parser.add_argument("--most", type=int, default=300)
    options = parser.parse_args()
    known, pairs = KnownPoints(options.points), list(pairs_of(options.root))
    rows = [judged(pair.name, *known(pair.name, pair.left, pair.right)) for pair in pairs]
    crossed = [(a, b) for a, b in combinations(pairs, 2) if set_of(a.name) != set_of(b.name)]
    random.Random(0).shuffle(crossed)
    held = sorted(file.stem for file in options.points.glob("*+*.npz"))
    rows += [judged(name, *known(name, Path(), Path())) for name in held]
    for a, b in crossed[: max(options.most - len(held), 0)]:
        name = f"{a.name}+{b.name}"
        rows.append(judged(name, *known(name, a.left, b.right)))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    table = [summary(name, rows) for name in sorted({part for row in rows for part in sets_of(row)})]
    limit = -config.Config().global_match.chance.significance
    table.append({"set": "all", **errors(rows, limit), "limit": limit})
    for line in table:
        print(json.dumps(line), file=sys.stderr)
    print(document.text("zpm2-bench-chance/2", table=table, rows=rows))


def judged(name: str, points: Any, *_: Any) -> dict[str, Any]:
    found = initial_geometry(points, config.preset("default").global_match, 0)
    return {"pair": name, "points": len(points), "agreeing": found.agreeing, "chance": round(found.chance, 1)}


def set_of(name: str) -> str:
    return name.replace("__", "/").split("/")[0].split("-")[0]


def sets_of(row: dict[str, Any]) -> set[str]:
    return {set_of(part) for part in row["pair"].split("+")}


def summary(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Of the pairs that a set is part of, by the limit that the other sets tell."""
    others = [row for row in rows if name not in sets_of(row)]
    two = min(row["chance"] for row in others if "+" in row["pair"])
    one = max(row["chance"] for row in others if "+" not in row["pair"] and row["chance"] < two)
    limit = (one + two) / 2
    return {"set": name, **errors([row for row in rows if name in sets_of(row)], limit), "limit": round(limit, 1)}


def errors(rows: list[dict[str, Any]], limit: float) -> dict[str, Any]:
    """Pairs of one scene and of two, and how many of them are on the wrong side of `limit`."""
    one = [row["chance"] for row in rows if "+" not in row["pair"]]
    two = [row["chance"] for row in rows if "+" in row["pair"]]
    wrong = sum(chance > limit for chance in one), sum(chance <= limit for chance in two)
    extremes = max(one, default=None), min(two, default=None)
    return {"one scene": len(one), "wrong 1": wrong[0], "two": len(two), "wrong 2": wrong[1], "extremes": extremes}


if __name__ == "__main__":
    main()
