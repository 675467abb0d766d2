"""The bridge to vismatch: with a stand-in of that package in a process of its own, and with the real one where
`ZPM2_VISMATCH_PYTHON` names a Python that has it."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from zpm2.config import PointsConfig
from zpm2.contract import points
from zpm2.errors import ConfigError, MissingDependency, PointMatcherError
from zpm2.features import PointMatcher, create
from zpm2.features.vismatch import PYTHON
from zpm2.model import Image

STAND_IN = """
import os
import sys
import numpy as np

class Matcher:
    def __init__(self, name, limit):
        self.name, self.limit = name, limit
    def __call__(self, left, right):
        print("vismatch talks")
        if self.name == "dies":
            raise RuntimeError("out of memory, say")
        at = np.array([[10.0, 20.0], [30.0, 40.0], [np.nan, 1.0]], np.float32)
        if self.name == "nothing":
            return {"matched_kpts0": np.zeros((0, 2)), "matched_kpts1": np.zeros((0, 2)), "matched_confidences": None}
        score = None if self.name == "unsure" else np.array([0.25, 0.75, 1.0])
        if self.name == "threads":
            score = np.full(3, int(os.environ.get("OMP_NUM_THREADS", 10)) / 10)
        shape = np.array([right.shape[2] / 2, right.shape[1] / 2])
        return {"matched_kpts0": at, "matched_kpts1": np.tile(shape, (3, 1)), "matched_confidences": score}

def get_matcher(name, device, max_num_keypoints):
    if name == "unheard-of":
        raise RuntimeError(f"Matcher {name} not yet supported")
    return Matcher(name, max_num_keypoints)
"""


# What the other end uses of torch, which takes seconds to load. The first test has the real one.
TORCH = """
def use_deterministic_algorithms(on, warn_only):
    pass

def from_numpy(array):
    return array

def manual_seed(seed):
    pass

def full(size, value):
    return value

def __getattr__(name):
    return abs
"""


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Python with a package of that name."""
    if sys.platform == "win32":
        pytest.skip("the stand-in is a shell script")
    (tmp_path / "vismatch.py").write_text(STAND_IN)
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH={tmp_path} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    monkeypatch.setenv(PYTHON, str(python))
    return python


@pytest.fixture
def quick(stand_in: Path) -> Path:
    """It has a stand-in of torch, too."""
    stand_in.with_name("torch.py").write_text(TORCH)
    return stand_in


def matcher(name: str, **changes: int) -> PointMatcher:
    return create(PointsConfig(methods=("vismatch",), options={"matcher": name}, **changes))


def image(width: int, height: int) -> Image:
    return Image(np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8))


def test_points_come_back(stand_in: Path) -> None:
    """The left image is seen at half its size: px 10, counted from centres, is 10.5 there and 21 of ours."""
    found = matcher("any", max_size=100).match(image(200, 160), image(100, 80))
    assert found.left.tolist() == [[61, 81], [21, 41]]
    assert found.right.tolist() == [[50.5, 40.5]] * 2
    assert found.score.tolist() == [0.75, 0.25]
    stand_in.with_name("torch.py").write_text(TORCH)
    assert matcher("roma").match(image(200, 160), image(100, 80)).left.tolist() == [[30, 40], [10, 20]]
    assert matcher("unsure").match(image(200, 160), image(100, 80)).score.tolist() == [1, 1]
    assert [len(each) for each in matcher("nothing").match_many([(image(64, 64), image(64, 64))] * 2)] == [0, 0]
    assert len(matcher("any", max_keypoints=1).match(image(64, 64), image(64, 64))) == 1


@pytest.mark.usefixtures("quick")
def test_what_the_other_process_says_is_told_in_one_line() -> None:
    with pytest.raises(PointMatcherError, match=r"^vismatch's matcher 'unheard-of' stopped: .* not yet supported$"):
        matcher("unheard-of")
    dying = matcher("dies")
    with pytest.raises(PointMatcherError, match=r"^vismatch's matcher 'dies' stopped: .*: out of memory, say$"):
        dying.match(image(64, 64), image(64, 64))
    with pytest.raises(PointMatcherError, match="out of memory"):
        dying.match(image(64, 64), image(64, 64))


@pytest.mark.usefixtures("quick")
def test_the_process_keeps_to_the_threads_that_we_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    for threads, score in ((3, 0.3), (None, 1.0)):
        monkeypatch.setattr("zpm2.features.vismatch.told", lambda threads=threads: threads)
        assert matcher("threads").match(image(64, 64), image(64, 64)).score.tolist() == [score] * 2


@pytest.mark.usefixtures("quick")
def test_the_process_ends_with_the_matcher() -> None:
    one = matcher("any")
    process = one.matchers[0]._process  # type: ignore[attr-defined]
    assert process.poll() is None
    del one
    assert process.poll() is not None


def test_what_it_needs(quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PYTHON, raising=False)
    with pytest.raises(ConfigError, match=r"needs a value of its option matcher: --set points\.options\.matcher="):
        create(PointsConfig(methods=("vismatch",)))
    with pytest.raises(MissingDependency, match=f"pip install vismatch, then set {PYTHON}="):
        matcher("roma")
    monkeypatch.setenv(PYTHON, "/nowhere/python")
    with pytest.raises(MissingDependency, match=f"^{PYTHON} is /nowhere/python: No such file"):
        matcher("roma")
    monkeypatch.setenv(PYTHON, str(quick))
    quick.with_name("vismatch.py").unlink()
    with pytest.raises(PointMatcherError, match=f"^{quick} has no vismatch: "):
        matcher("roma")


@pytest.mark.parametrize("check", points.CHECKS)
def test_contract_of_the_real_one(check: str) -> None:
    if not os.environ.get(PYTHON):
        pytest.skip(f"{PYTHON} names no Python that has vismatch")
    points.CHECKS[check](lambda side: matcher("sift-nn", max_size=side))
