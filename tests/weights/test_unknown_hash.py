"""Files whose size and hash we do not know: the hub states both, and what it stated holds from then on."""

import hashlib
from pathlib import Path

import pytest
from loopback import CONTENT, HUB, Server

from zpm2 import weights
from zpm2.errors import WeightsError
from zpm2.weights import Entry, cache_dir

SHA256 = hashlib.sha256(CONTENT).hexdigest()
STATED = {"X-Linked-Etag": f'"{SHA256}"', "X-Linked-Size": str(len(CONTENT))}


@pytest.fixture(autouse=True)
def unknown(monkeypatch: pytest.MonkeyPatch) -> Entry:
    item = Entry("tiny", "tiny.pt", 0, "", "MIT", "tests", "its home", (HUB,))
    for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
        monkeypatch.setattr(f"{module}.MANIFEST", (item,))
    return item


def test_what_the_hub_states_is_checked_and_pinned(hub: Server) -> None:
    hub.heads = STATED
    path = weights.get("tiny")
    assert path.read_bytes() == CONTENT
    assert {each.name for each in cache_dir().iterdir()} == {"tiny.pt", "tiny.pt.pinned.json", "tiny.pt.verified.json"}
    assert SHA256 in (weights.hash_note("tiny", path) or "")
    assert weights.status()[0].path == path
    assert weights.verify("tiny") == path
    path.write_bytes(CONTENT[::-1])
    with pytest.raises(WeightsError, match=f"instead of {SHA256}"):
        weights.verify("tiny")


def test_a_changed_copy_is_fetched_again(hub: Server, caplog: pytest.LogCaptureFixture) -> None:
    hub.heads = STATED
    weights.get("tiny").write_bytes(b"changed")
    assert weights.get("tiny").read_bytes() == CONTENT
    assert "fetching it again" in caplog.text


@pytest.mark.parametrize(
    ("heads", "said"),
    [
        ({}, "does not state the size and sha256"),
        (STATED | {"X-Linked-Etag": '"W/short"'}, "does not state the size and sha256"),
        (STATED | {"X-Linked-Size": "many"}, "does not state the size and sha256"),
        (STATED | {"X-Linked-Etag": "0" * 64}, "its file has sha256"),
        (STATED | {"X-Linked-Size": "7"}, "sends more than 7 bytes"),
    ],
)
def test_a_hub_that_states_nothing_or_something_else(hub: Server, heads: dict[str, str], said: str) -> None:
    hub.heads = heads
    with pytest.raises(WeightsError, match=said) as caught:
        weights.get("tiny")
    assert "\n" not in str(caught.value)
    assert not list(cache_dir().glob("tiny.pt*"))


def test_a_file_put_into_the_cache_by_hand_is_pinned(monkeypatch: pytest.MonkeyPatch) -> None:
    cache_dir().mkdir(parents=True)
    (cache_dir() / "tiny.pt").write_bytes(CONTENT)
    path = weights.get("tiny")
    assert SHA256 in (weights.hash_note("tiny", path) or "")
    path.write_bytes(b"changed")
    with pytest.raises(WeightsError, match="bytes instead of"):
        weights.verify("tiny")


def test_the_users_own_copy_is_taken_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "tiny.pt").write_bytes(b"mine")
    path = weights.get("tiny", directory=tmp_path)
    assert path == tmp_path / "tiny.pt"
    assert weights.hash_note("tiny", path) == "zpm2 does not know the hash of tiny.pt: your copy was taken as it is"
    (tmp_path / "tiny.pt").write_bytes(b"mine, again")
    assert weights.get("tiny", directory=tmp_path) == path


def test_a_damaged_pin_is_one_line() -> None:
    cache_dir().mkdir(parents=True)
    (cache_dir() / "tiny.pt").write_bytes(CONTENT)
    (cache_dir() / "tiny.pt.pinned.json").write_text("[]")
    with pytest.raises(WeightsError, match=r"tiny\.pt\.pinned\.json is damaged: remove it"):
        weights.get("tiny")


def test_known_files_need_no_note() -> None:
    from zpm2.weights import manifest

    assert all(item.hash_known == bool(item.size) for item in manifest.MANIFEST)
