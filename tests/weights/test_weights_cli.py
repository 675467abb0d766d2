"""`zpm2 weights` as a person uses it, and licences that must be accepted."""

import dataclasses
import json
from pathlib import Path

import pytest
from loopback import CONTENT, Server
from typer.testing import CliRunner, Result

from zpm2 import weights
from zpm2.cli.weights import app
from zpm2.errors import WeightsError
from zpm2.weights import Entry, cache_dir


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def restricted(manifest: Entry, hub: Server, monkeypatch: pytest.MonkeyPatch) -> Entry:
    """The manifest's file, plus one under a licence that must be accepted."""
    item = dataclasses.replace(manifest, name="closed", file="closed.pt", licence="Research only", terms="its terms")
    for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
        monkeypatch.setattr(f"{module}.MANIFEST", (manifest, item))
    return item


def test_list_get_path_verify(hub: Server, manifest: Entry):
    assert "-" in run("list").stdout
    got = run("get", "tiny")
    assert (got.exit_code, got.stdout) == (0, f"tiny: {cache_dir() / 'tiny.pt'}\n")
    listing = run("list").stdout
    assert "cache" in listing
    assert str(cache_dir()) in listing
    assert run("path", "tiny").stdout == f"{cache_dir() / 'tiny.pt'}\n"
    assert run("verify").stdout == run("verify", "tiny").stdout == f"tiny: {cache_dir() / 'tiny.pt'} is intact\n"
    assert len(hub.asked) == 1


def test_list_as_json(manifest: Entry, hub: Server):
    (row,) = json.loads(run("list", "--json").stdout)
    assert row["path"] is None
    assert row["sha256"] == manifest.sha256
    run("get", "tiny")
    assert json.loads(run("list", "--json").stdout)[0]["path"] == str(cache_dir() / "tiny.pt")


def test_weights_dir(manifest: Entry, tmp_path: Path):
    (tmp_path / "tiny.pt").write_bytes(CONTENT)
    for command in ("get", "path", "verify"):
        assert str(tmp_path / "tiny.pt") in run(command, "tiny", "--weights-dir", str(tmp_path)).stdout
    assert "yours" in run("list", "--weights-dir", str(tmp_path)).stdout


def test_errors_reach_the_caller(manifest: Entry):
    for arguments in (("get", "tiny"), ("path", "tiny"), ("verify", "tiny"), ("get", "tniy")):
        assert isinstance(run(*arguments).exception, WeightsError)


def test_verify_all_finds_the_wrong_one(restricted: Entry):
    cache_dir().mkdir(parents=True)
    (cache_dir() / "tiny.pt").write_bytes(CONTENT)
    (cache_dir() / "closed.pt").write_bytes(CONTENT[:-1])
    result = run("verify")
    assert "tiny.pt is intact" in result.stdout
    assert "closed.pt has" in result.stderr
    assert str(result.exception) == "1 of 2 weights failed, see above: closed"


def test_licence_is_asked_for_once(restricted: Entry, hub: Server):
    with pytest.raises(WeightsError, match=r"Research only, see its terms.*zpm2 weights get closed --accept-licence"):
        weights.get("closed")
    refused = run("get", "closed")
    assert isinstance(refused.exception, WeightsError)
    assert hub.asked == []
    accepted = run("get", "closed", "--accept-licence")
    assert accepted.exit_code == 0
    assert "closed: Research only, see its terms" in accepted.stderr
    assert weights.get("closed") == cache_dir() / "closed.pt"
    (cache_dir() / "accepted-licences.txt").unlink()
    with pytest.raises(WeightsError, match="--accept-licence"):
        weights.get("closed")


def test_acceptance_that_cannot_be_recorded_holds_for_this_call(
    restricted: Entry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    (tmp_path / "closed.pt").write_bytes(CONTENT)
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "file"))
    assert weights.get("closed", directory=tmp_path, accept_licence=True) == tmp_path / "closed.pt"
    assert "it will be asked for again" in caplog.text


def test_get_all_leaves_out_what_must_be_accepted(restricted: Entry):
    assert run("get", "all").stdout == f"tiny: {cache_dir() / 'tiny.pt'}\n"
    assert "closed.pt" in run("get", "all", "--accept-licence").stdout


def test_get_all_leaves_out_what_is_of_unknown_size(restricted: Entry, monkeypatch: pytest.MonkeyPatch):
    first, *others = weights.MANIFEST
    unknown = dataclasses.replace(first, name="unknown", file="unknown.pt", size=0, sha256="")
    for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
        monkeypatch.setattr(f"{module}.MANIFEST", (unknown, first, *others))
    assert run("get", "all").stdout == f"tiny: {cache_dir() / 'tiny.pt'}\n"


def test_one_that_fails_does_not_stop_the_others(restricted: Entry):
    result = run("get", "closed", "tiny")
    assert f"tiny: {cache_dir() / 'tiny.pt'}" in result.stdout
    assert "--accept-licence" in result.stderr
    assert str(result.exception) == "1 of 2 weights failed, see above: closed"
