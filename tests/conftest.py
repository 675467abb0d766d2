"""Isolation from the machine's caches and networks, the command line in-process, and a rendered pair."""

import os
import sys
from pathlib import Path

# Test processes run side by side, one for each core: each computes with one thread. Before numpy and torch are loaded.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from rendered import Outcome, Pair, Run, save_pair

from zpm2.cli import app
from zpm2.evaluate.rendered import render_scene

HERE = Path(__file__).parent

# Damaged files are read under a limit of memory that only Linux has; Windows has no signals to kill a command with.
collect_ignore = [] if sys.platform == "linux" else ["fuzz/test_mutants.py"]
collect_ignore += ["kill/test_kills.py"] if sys.platform == "win32" else []

# Time is no property of a result: machines are shared. Examples are the same each time, but with
# --hypothesis-profile=explore.
settings.register_profile("zpm2", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("zpm2")


# The test files that take longest, in this order: they start first, so that no core waits for another one at the end.
SLOWEST = (
    "test_docs.py",
    "reconstruct/test_reconstruct.py",
    "reconstruct/test_resumed.py",
    "segment/test_segmenters.py",
    "test_one_entry.py",
    "cli/test_cloud.py",
    "test_stale_results.py",
    "test_hard_cases.py",
    "evaluate/test_runs.py",
    "test_plugin_package.py",
    "kill/test_kills.py",
    "segment/test_sam_view.py",
    "test_runtime.py",
    "test_bad_input.py",
    "tiled/test_tiled_matcher.py",
    "tiled/test_thin.py",
    "segment/test_transformers_sam.py",
    "features/test_pair_networks.py",
    "fuzz/test_mutants.py",
    "test_end_to_end.py",
    "segment/test_sam_network.py",
    "segment/test_sam2_onnx.py",
    "cloud/test_picture.py",
    "test_same_bytes.py",
    "weights/test_slow.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {HERE / name: k for k, name in enumerate(SLOWEST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


@pytest.fixture(autouse=True)
def _own_weights(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only tests marked `weights` see the machine's weights and may fetch them; no option outlives its test."""
    monkeypatch.setenv("ZPM2_ALLOW_VRT", "")
    if not request.node.get_closest_marker("weights"):
        monkeypatch.setenv("ZPM2_WEIGHTS", "")
        monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "cache"))
        monkeypatch.setenv("ZPM2_OFFLINE", "1")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """`run("match", ...)`: what a person who types `zpm2 match ...` gets, `main`'s error handling included."""

    def call(*arguments: object) -> Outcome:
        monkeypatch.setattr("sys.argv", ["zpm2", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            app.main()
        assert isinstance(left.value.code, int)
        return Outcome(left.value.code, *capsys.readouterr())

    return call


@pytest.fixture(scope="session")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """The demo's scene at 400 x 240 px."""
    return save_pair(render_scene(0, 400, 240), tmp_path_factory.mktemp("pair"))
