"""Isolation from the machine's own cache and network, and the loopback server as hub and registry."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from loopback import CONTENT, HUB, WHEEL, Server, serve, tiny

from zpm2.weights import Entry, carriers, fetch, npm


@pytest.fixture
def server() -> Iterator[Server]:
    with serve() as state:
        yield state


@pytest.fixture(autouse=True)
def own_environment(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test but the one with real weights sees the cache, pip configuration, proxy or switches of the machine."""
    if request.node.get_closest_marker("weights"):
        return
    for name in ("ZPM2_WEIGHTS", "ZPM2_OFFLINE", "HF_HUB_OFFLINE", "PIP_EXTRA_INDEX_URL", "PIP_NO_INDEX", "PIP_CERT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")  # nobody listens there
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple/")
    for name in ("NPM_CONFIG_REGISTRY", "npm_config_cafile", "NPM_CONFIG_CAFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("npm_config_registry", "http://127.0.0.1:9/")
    monkeypatch.setattr(fetch, "_hub_rests_until", 0.0)


@pytest.fixture
def registry(server: Server, monkeypatch: pytest.MonkeyPatch) -> Server:
    """The server as pip's index. pip itself is not asked: that takes half a second."""
    monkeypatch.setenv("PIP_INDEX_URL", f"{server.address}/simple/")
    monkeypatch.setattr(carriers, "_pip_files", dict)
    return server


@pytest.fixture
def npm_registry(server: Server, monkeypatch: pytest.MonkeyPatch) -> Server:
    """The server as npm's registry. npm itself is not asked."""
    monkeypatch.setenv("npm_config_registry", server.address)
    monkeypatch.setattr(npm, "_npm_settings", lambda names: {})
    return server


@pytest.fixture
def hub(server: Server, monkeypatch: pytest.MonkeyPatch) -> Server:
    """The server as the hub, offering the file."""
    monkeypatch.setenv("HF_ENDPOINT", server.address)
    server.files["/owner/models/resolve/main/tiny.pt"] = CONTENT
    return server


@pytest.fixture
def manifest(monkeypatch: pytest.MonkeyPatch) -> Entry:
    """A manifest of that one file, from hub then wheel, under a licence that needs no acceptance."""
    item = tiny(HUB, WHEEL)
    for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
        monkeypatch.setattr(f"{module}.MANIFEST", (item,))
    return item
