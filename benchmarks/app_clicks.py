"""How long `zpm2 app` takes from a click to the region in the other photograph, beside a whole match of the pair.

python benchmarks/app_clicks.py LEFT RIGHT [--clicks N] [--rounds N] [--set stage.field=value]...

Clicks are drawn with a seed from the middle of the left photograph. In each round the pair is matched once and all
clicks are answered once, all models warm, so that what else the machine does falls on both. `first`: until the app
can be clicked on. Seconds are medians: `wall` by the clock, `processor` of all cores together.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import document
import numpy as np

from zpm2.app.pair import Pair
from zpm2.app.prompt import Prompt
from zpm2.app.session import made
from zpm2.config import assign, preset
from zpm2.errors import InputError
from zpm2.pipeline import PairMatcher

SEED = 0
MARGIN = 0.1  # of each side, left out


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Seconds by the clock and of the processor."""
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - processor


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("left", type=Path)
    words.add_argument("right", type=Path)
    words.add_argument("--clicks", type=int, default=10)
    words.add_argument("--rounds", type=int, default=3)
    words.add_argument("--set", dest="settings", action="append", default=[])
    asked = words.parse_args()
    config = assign(preset("default"), asked.settings)
    matcher = PairMatcher(config)
    session = made(config, lambda text: None)
    session.open(asked.left, asked.right)
    left, right = session.photographs
    assert left is not None
    assert right is not None
    pair = Pair((left, right), session.matcher, session.progress)
    shares = np.random.default_rng(SEED).uniform(MARGIN, 1 - MARGIN, (asked.clicks, 2))
    places = shares * (left.width, left.height)
    answered = 0

    def click(place: np.ndarray) -> None:
        nonlocal answered
        try:
            drawn = pair.draw(0, Prompt(place[None], np.zeros((0, 2)), None, None))
        except InputError:
            return
        answered += pair.carry(0, drawn.shape).shape is not None

    first = timed(pair.prepare)
    matcher(asked.left, asked.right)
    rows = []
    for _ in range(asked.rounds):
        answered = 0
        match = timed(lambda: matcher(asked.left, asked.right))
        clicks = [timed(lambda place=place: click(place)) for place in places]
        wall, processor = (statistics.median(each) for each in zip(*clicks, strict=True))
        rows.append(
            {
                "match": {"wall": match[0], "processor": match[1]},
                "click": {"wall": wall, "processor": processor},
                "ratio": {"wall": wall / match[0], "processor": processor / match[1]},
                "found": answered,
            }
        )
    found = {"first": {"wall": first[0], "processor": first[1]}, "clicks": asked.clicks, "rows": rows}
    print(document.text("zpm2-bench-app/1", pair=[asked.left.name, asked.right.name], **found))


if __name__ == "__main__":
    main()
