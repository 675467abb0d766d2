"""Each number of the configuration at both ends of what is allowed: refused before the work, or worked with in time."""

import contextlib
import signal
from collections.abc import Iterator

import numpy as np
import pytest
from rendered import Pair, save_pair

from zpm2.config import Config, assign, preset
from zpm2.config.fields import rule_of
from zpm2.config.whole import _fields
from zpm2.errors import ConfigError, Failed, InputError
from zpm2.evaluate.rendered.scene import render_scene
from zpm2.model import Camera
from zpm2.pipeline import PairMatcher
from zpm2.pose import PoseFinder
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter

SECONDS = 20
NETWORKS = ("segment.", "guided.", "raster.", "tiles.", "cloud.")  # need weights, rasters or a mesh: tests of their own
OTHERS = ("carry.", "link.", "tracks.", "stereo.", "reconstruct.")  # neither matching nor pose of a pair reads them
NUMBERS = {
    name: rule_of(item)
    for name, item, value in _fields(Config())
    if type(value) in (int, float) and not name.startswith(NETWORKS)
}
pytestmark = pytest.mark.skipif(not hasattr(signal, "alarm"), reason="the system has no alarm")
QUICK = ["points.methods=sift", "device=cpu", "pose.crops=off"]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    return save_pair(render_scene(0, 160, 120), tmp_path_factory.mktemp("small"))


@pytest.fixture(autouse=True)
def in_time() -> Iterator[None]:
    def late(*_: object) -> None:
        raise AssertionError(f"it takes more than {SECONDS} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def matched(config: Config, pair: Pair) -> MatchResult:
    regions = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    return PairMatcher(config, segmenter=regions)(pair.left, pair.right)


@pytest.fixture(scope="module")
def usual(small: Pair) -> MatchResult:
    return matched(assign(preset("default"), QUICK), small)


@pytest.mark.parametrize("end", ["least", "most"])
@pytest.mark.parametrize("name", NUMBERS)
def test_an_option_at_its_end(name: str, end: str, small: Pair, usual: MatchResult) -> None:
    rule = NUMBERS[name]
    value = rule.low if end == "least" else rule.high
    try:
        config = assign(preset("default"), [*QUICK, f"{name}={value:.10g}"])
        config.check_together()
    except ConfigError:
        return
    if name.startswith(OTHERS) or config == assign(preset("default"), QUICK):
        return
    if not name.startswith("pose."):
        with contextlib.suppress(ConfigError, InputError):
            assert matched(config, small).matches is not None
        return
    scene = small.scene
    camera = Camera(np.array([[scene.f, 0, scene.cx], [0, scene.f, scene.cy], [0, 0, 1.0]]), (160, 120))
    found = PoseFinder(config)(usual, (camera, camera))
    assert isinstance(found.pose, Failed) or np.isfinite(found.pose.rotation).all()
