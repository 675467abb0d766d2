"""Threads share a matcher; a forked child says at once that it cannot use networks."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from rendered import Pair

from zpm2 import Zpm2Error, runtime
from zpm2.api import Matcher
from zpm2.baselines import BaselineMatcher
from zpm2.config import Config, PointsConfig, SegmentConfig, TilesConfig
from zpm2.errors import ForkError
from zpm2.features import create
from zpm2.model import Image, Mask
from zpm2.pipeline import PairMatcher
from zpm2.runtime import ForkAwareLock
from zpm2.segment.predictions import MaskThresholds, Prompts
from zpm2.segment.sam import SamSegmenter
from zpm2.segment.sam_backend import EmbeddedPrompts

SIFT = PointsConfig(methods=("sift",))
CONFIG = Config(points=SIFT, device="cpu")
needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")


class Alone:
    """Notices when two are in it at a time."""

    def __init__(self) -> None:
        self.inside = 0
        self.calls = 0

    def __enter__(self) -> None:
        self.inside += 1
        self.calls += 1
        time.sleep(0.005)
        assert self.inside == 1, "two threads at a time"

    def __exit__(self, *_: object) -> None:
        self.inside -= 1


class OneSquare:
    """A segmenter that bears one thread at a time, as a network does."""

    name = "one square"

    def __init__(self) -> None:
        self.alone = Alone()

    def segment(self, image: Image) -> list[Mask]:
        with self.alone:
            return [Mask(20, 20, np.ones((60, 60), bool), 0.9)]


MATCHERS: dict[str, Callable[[OneSquare], Callable[..., object]]] = {
    "whole": lambda segmenter: PairMatcher(CONFIG, segmenter=segmenter),
    "tiled": lambda segmenter: Matcher(
        Config(points=SIFT, device="cpu", tiles=TilesConfig(mode="on", size=256)), segmenter=segmenter
    ),
    "baseline": lambda segmenter: BaselineMatcher("shape-context", CONFIG, segmenter=segmenter),
    "regions": lambda segmenter: (
        lambda left, right: PairMatcher(CONFIG, segmenter=segmenter).regions(Image(np.zeros((100, 100, 3), np.uint8)))
    ),
}


@pytest.mark.parametrize("kind", ["whole", "tiled", "baseline"])
def test_threads_share_a_matcher(kind: str, pair: Pair) -> None:
    segmenter = OneSquare()
    matcher = MATCHERS[kind](segmenter)
    with ThreadPoolExecutor(3) as pool:
        for found in [pool.submit(matcher, pair.left, pair.right) for _ in range(3)]:
            found.result(60)
    assert segmenter.alone.calls >= 6


class OneRequest:
    """SAM's networks with one memory for what they find, as those of OpenVINO on one core."""

    name, batch, few = "openvino", 4, 0

    def __init__(self) -> None:
        self.alone = Alone()
        self.iou = np.zeros((4, 4), np.float32)

    def embed(self, points: np.ndarray, labels: np.ndarray) -> np.ndarray:
        return points

    def image(self, pixels: np.ndarray) -> list[np.ndarray]:
        with self.alone:
            return []

    def masks(
        self,
        parts: object,
        asked: EmbeddedPrompts,
        least: float,
        first: int,
        size: tuple[int, int],
        soon: object = None,
    ) -> tuple[np.ndarray, ...]:
        with self.alone:
            self.iou[:] = asked.sparse.ravel()[0] / 1000
        with self.alone:
            iou = self.iou[:, first:].copy()
            rows = np.flatnonzero((iou >= least).any(1))
            return rows, iou[rows], np.full((len(rows), iou.shape[1], *size), 5, np.float32)


def test_threads_share_a_segmenter_and_get_their_own_answers() -> None:
    segmenter, backend = SamSegmenter(SegmentConfig()), OneRequest()
    segmenter._backend = backend  # type: ignore[assignment]

    def scores(number: int) -> set[float]:
        view = segmenter.view(Image(np.zeros((1024, 1024, 3), np.uint8)))
        points = np.full((4, 1, 2), 100.0 * number)
        return {
            round(score, 3)
            for score in view.predict(Prompts(points, np.array([1])), MaskThresholds(0.05, 0)).score.tolist()
        }

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(scores, range(1, 9))) == [{round(0.1 * k, 3)} for k in range(1, 9)]


def in_child(action: Callable[[], object]) -> str:
    """What a forked child says that does `action`; it has 20 seconds."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            action()
            said = "done"
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
        os.write(writer, said.encode())
        os._exit(0)
    os.close(writer)
    over = threading.Timer(20, os.kill, (child, 9))
    over.start()
    with os.fdopen(reader, "rb") as file:
        said = file.read().decode()
    over.cancel()
    os.waitpid(child, 0)
    return said


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """This process has networks, and has not later."""
    monkeypatch.setattr(runtime, "_loaded_in", None)
    runtime.mark_networks_loaded()


@needs_fork
@pytest.mark.parametrize("kind", MATCHERS)
def test_a_forked_child_is_told_at_once(kind: str, pair: Pair, loaded: None) -> None:
    matcher = MATCHERS[kind](OneSquare())
    assert in_child(lambda: matcher(pair.left, pair.right)).startswith("ForkError: this process was forked")


@needs_fork
@pytest.mark.parametrize(
    "action",
    [
        runtime.mark_networks_loaded,
        lambda: create(SIFT).match(Image(np.zeros((64, 64, 3), np.uint8)), Image(np.zeros((64, 64, 3), np.uint8))),
        lambda: create(SIFT).match_many([]),
        lambda: SamSegmenter(SegmentConfig()).load(),
    ],
)
def test_so_are_its_parts(action: Callable[[], object], loaded: None) -> None:
    said = in_child(action)
    assert said.startswith("ForkError")
    assert 'get_context("spawn")' in said
    assert issubclass(ForkError, Zpm2Error)


@needs_fork
def test_a_child_forked_before_networks_were_loaded_may(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "_loaded_in", None)
    assert in_child(runtime.mark_networks_loaded) == "done"


@needs_fork
def test_a_child_does_not_wait_for_a_thread_that_it_does_not_have(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "_loaded_in", None)
    one, inside, leave = ForkAwareLock(), threading.Event(), threading.Event()

    def hold() -> None:
        with one:
            inside.set()
            leave.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    inside.wait(60)

    def enter() -> None:
        with one, one:
            pass

    said = in_child(enter)
    leave.set()
    thread.join()
    assert said == "done"


SCRIPT = """
import os, sys
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from zpm2 import Zpm2Error, config
from zpm2.pipeline import PairMatcher
pair = sys.argv[1:]
matcher = PairMatcher(config.assign(config.preset("paper"), ["segment.grid=4", "points.max_keypoints=500"]))
alone = matcher(*pair)
with ThreadPoolExecutor(2) as pool:
    found = [f.result() for f in [pool.submit(matcher, *pair) for _ in range(2)]]
assert all(len(r.matches) == len(alone.matches) > 0 for r in found)
if hasattr(os, "fork"):
    child = os.fork()
    if child == 0:
        try:
            matcher(*pair)
        except Zpm2Error:
            os._exit(7)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
print("right")
"""


@pytest.mark.weights
def test_with_real_networks(pair: Pair) -> None:
    words = [sys.executable, "-W", "ignore", "-c", SCRIPT, str(pair.left), str(pair.right)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=200, check=False)
    assert done.stdout == "right\n", done.stderr
