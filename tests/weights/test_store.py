"""Own folder before cache, verification once, and loading."""

import hashlib
import json
import os
import pickle
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from loopback import CONTENT, Server

from zpm2 import runtime, weights
from zpm2.errors import WeightsError
from zpm2.runtime import MKL_FUNCTIONS, settle_torch
from zpm2.weights import Entry, cache_dir, store


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A user's folder with the right file."""
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "tiny.pt").write_bytes(CONTENT)
    return folder


@pytest.fixture
def hashed(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that were hashed."""
    seen: list[Path] = []
    real = store.sha256_of
    monkeypatch.setattr(store, "sha256_of", lambda path: seen.append(path) or real(path))
    return seen


def test_own_folder_comes_first(own: Path, hub: Server, manifest: Entry, monkeypatch: pytest.MonkeyPatch):
    assert weights.get("tiny", directory=own) == own / "tiny.pt"
    monkeypatch.setenv("ZPM2_WEIGHTS", str(own))
    assert weights.get("tiny") == own / "tiny.pt"
    assert weights.status() == [(manifest, own / "tiny.pt")]
    assert hub.asked == []


def test_own_folder_without_the_file_passes_on(tmp_path: Path, hub: Server, manifest: Entry):
    assert weights.get("tiny", directory=tmp_path) == cache_dir() / "tiny.pt"


def test_own_folder_that_does_not_exist(tmp_path: Path, manifest: Entry):
    with pytest.raises(WeightsError, match="nowhere does not exist"):
        weights.get("tiny", directory=tmp_path / "nowhere")


@pytest.mark.parametrize("content", [CONTENT[::-1], b"short"])
def test_wrong_file_in_the_own_folder_is_an_error(own: Path, hub: Server, manifest: Entry, content: bytes):
    (own / "tiny.pt").write_bytes(content)
    with pytest.raises(WeightsError, match=rf"tiny\.pt has .* instead of .*replace it by .*{manifest.sha256}"):
        weights.get("tiny", directory=own)
    assert hub.asked == []


def test_damaged_cache_is_reported_and_fetched_again(hub: Server, manifest: Entry, caplog: pytest.LogCaptureFixture):
    path = weights.get("tiny")
    path.write_bytes(CONTENT[::-1])
    os.utime(path, ns=(1, 1))
    assert weights.get("tiny").read_bytes() == CONTENT
    assert "fetching it again" in caplog.text
    assert len(hub.asked) == 2


def test_marker_spares_hashing_until_the_file_changes(own: Path, manifest: Entry, hashed: list[Path]):
    for _ in range(3):
        weights.get("tiny", directory=own)
    assert len(hashed) == 1
    os.utime(own / "tiny.pt", ns=(5, 5))
    weights.get("tiny", directory=own)
    assert len(hashed) == 2
    weights.verify("tiny", directory=own)
    assert len(hashed) == 3


def test_marker_of_another_hash_or_unreadable_is_not_believed(own: Path, manifest: Entry, hashed: list[Path]):
    weights.get("tiny", directory=own)
    marker = cache_dir() / "tiny.pt.verified.json"
    marker.write_text(json.dumps(json.loads(marker.read_text()) | {"sha256": "0" * 64}))
    weights.get("tiny", directory=own)
    marker.write_text("{")
    weights.get("tiny", directory=own)
    assert len(hashed) == 3


def test_own_folder_works_beside_a_cache_that_cannot_be_written(
    own: Path, manifest: Entry, hashed: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "file"))
    assert weights.get("tiny", directory=own) == weights.get("tiny", directory=own) == own / "tiny.pt"
    assert len(hashed) == 2
    with pytest.raises(WeightsError, match="cannot write tiny"):
        weights.converted("tiny", "key", lambda folder: None)


def test_verify_does_not_trust_a_marker(own: Path, manifest: Entry):
    path = own / "tiny.pt"
    weights.get("tiny", directory=own)
    times = path.stat().st_atime_ns, path.stat().st_mtime_ns
    path.write_bytes(CONTENT[::-1])
    os.utime(path, ns=times)
    assert weights.get("tiny", directory=own) == path
    with pytest.raises(WeightsError, match="has sha256"):
        weights.verify("tiny", directory=own)


def test_verify_and_locate_fetch_nothing(hub: Server, manifest: Entry):
    for ask in (weights.verify, weights.locate):
        with pytest.raises(WeightsError, match="zpm2 weights get tiny"):
            ask("tiny")
    assert hub.asked == []


def test_cache_is_the_platforms_unless_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    assert cache_dir() == tmp_path / "cache" / "weights"
    monkeypatch.delenv("ZPM2_CACHE")
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: f"/caches/{name}")
    assert cache_dir() == Path("/caches/zpm2/weights")


def put(monkeypatch: pytest.MonkeyPatch, folder: Path, content: bytes) -> None:
    """Make `content` the manifest's only file, and lay it into `folder`."""
    sha256 = hashlib.sha256(content).hexdigest()
    item = Entry("tiny", "tiny.pt", len(content), sha256, "MIT", "tests", "its home", ())
    monkeypatch.setattr("zpm2.weights.manifest.MANIFEST", (item,))
    (folder / "tiny.pt").write_bytes(content)


@pytest.mark.parametrize("outer", [None, "extractor"])
def test_load_state_dict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outer: str | None):
    import torch

    state = {"a.weight": torch.arange(3.0), "a.bias": torch.zeros(1)}
    torch.save({outer: state} if outer else state, tmp_path / "saved")
    put(monkeypatch, tmp_path, (tmp_path / "saved").read_bytes())
    loaded = weights.load_state_dict("tiny", directory=tmp_path)
    assert list(loaded) == ["a.weight", "a.bias"]
    assert loaded["a.weight"].tolist() == [0, 1, 2]


def test_torch_computes_one_number_before_a_network_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Else its first call in several threads may be less exact, now and then: `zpm2.runtime.settle_torch`."""
    import torch
    from torch.overrides import TorchFunctionMode

    class Calls(TorchFunctionMode):
        def __torch_function__(self, function, types, args=(), kwargs=None):
            if function.__name__ in MKL_FUNCTIONS:
                seen[function.__name__].append((args[0].numel(), args[0].dtype))
            return function(*args, **(kwargs or {}))

    seen: defaultdict[str, list[tuple[int, torch.dtype]]] = defaultdict(list)
    torch.save({"a": torch.zeros(1)}, tmp_path / "saved")
    put(monkeypatch, tmp_path, (tmp_path / "saved").read_bytes())
    settle_torch.cache_clear()
    with Calls():
        weights.load_state_dict("tiny", directory=tmp_path)
        torch.cos(torch.zeros(100_000))
    once = [(1, torch.float32), (1, torch.float64)]
    assert seen == dict.fromkeys(MKL_FUNCTIONS, once) | {"cos": [*once, (100_000, torch.float32)]}


@pytest.mark.parametrize(("usable", "expected"), [(1, 1), (5, 2)])
def test_torch_takes_no_more_threads_than_there_are_cores_to_use(
    monkeypatch: pytest.MonkeyPatch, usable: int, expected: int
):
    import torch

    before = torch.get_num_threads()
    monkeypatch.setattr(runtime, "usable", lambda: usable)
    try:
        torch.set_num_threads(2)
        settle_torch.cache_clear()
        settle_torch()
        assert torch.get_num_threads() == expected
    finally:
        torch.set_num_threads(before)


class Trap:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("sprung",)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (pickle.dumps({"a": Trap()}, protocol=2), "cannot be read as weights"),
        (b"not a pickle", "cannot be read as weights"),
        (b"", "cannot be read as weights"),
        (pickle.dumps([1, 2], protocol=2), "cannot be read as weights|something other than named tensors"),
    ],
)
def test_load_refuses_what_is_no_state_dict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, said: str):
    monkeypatch.chdir(tmp_path)
    put(monkeypatch, tmp_path, content)
    with pytest.raises(WeightsError, match=said) as caught:
        weights.load_state_dict("tiny", directory=tmp_path)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "sprung").exists()


def test_load_refuses_other_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    import torch

    torch.save({"a": 1, "b": torch.zeros(1)}, tmp_path / "saved")
    put(monkeypatch, tmp_path, (tmp_path / "saved").read_bytes())
    with pytest.raises(WeightsError, match="something other than named tensors"):
        weights.load_state_dict("tiny", directory=tmp_path)


@pytest.mark.weights
def test_xfeat_for_real():
    path = weights.get("xfeat")
    assert path.stat().st_size == weights.entry("xfeat").size
    assert weights.verify("xfeat") == path
    assert weights.load_state_dict("xfeat")["skip1.1.weight"].shape == (24, 1, 1, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="processes")
def test_what_a_killed_download_left_goes_with_the_next_one(hub: Server, manifest: Entry):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left, at_work = (cache_dir() / f".{number}-abcdefgh.part" for number in (gone.pid, os.getppid()))
    for folder in (left, at_work):
        folder.mkdir(parents=True)
        (folder / "tiny.pt").write_bytes(CONTENT[:2])
    weights.get("tiny")
    assert (left.exists(), at_work.exists()) == (False, True)
    assert not [p for p in cache_dir().iterdir() if p.suffix == ".part" and p != at_work]


@pytest.mark.skipif(sys.platform == "win32", reason="processes")
@pytest.mark.parametrize("again", [weights.get, weights.locate, weights.verify])
def test_what_was_left_by_a_run_that_was_killed_at_its_end_goes_too(own: Path, manifest: Entry, again):
    """The file has its name already, so nothing is fetched."""
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left = cache_dir() / f".{gone.pid}-abcdefgh.part"
    left.mkdir(parents=True)
    again("tiny", directory=own)
    assert not left.exists()
