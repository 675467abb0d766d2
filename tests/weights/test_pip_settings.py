"""Which index and certificates pip would use."""

from pathlib import Path

import pytest

from zpm2.weights import carriers


def test_files_are_read_and_the_environment_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    config = tmp_path / "pip.conf"
    config.write_text(
        "[global]\nindex-url = https://one.test/simple\ncert = /some/ca.pem\n"
        "extra-index-url = file:///local/simple\n    https://user:secret@two.test/simple\n"
        "[install]\nindex-url = https://three.test/simple\n"
    )
    monkeypatch.setenv("PIP_CONFIG_FILE", str(config))
    monkeypatch.delenv("PIP_INDEX_URL")
    settings = carriers.pip_settings()
    assert settings.indexes[0] == "https://three.test/simple"
    assert settings.indexes[-1] == "https://user:secret@two.test/simple"
    assert not any(address.startswith("file:") for address in settings.indexes)
    assert settings.cert == "/some/ca.pem"
    monkeypatch.setenv("PIP_INDEX_URL", "https://four.test/simple")
    assert carriers.pip_settings().indexes[0] == "https://four.test/simple"


def test_without_pip_the_environment_still_counts(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.executable", "/no/such/python")
    monkeypatch.setenv("PIP_CERT", "/some/ca.pem")
    settings = carriers.pip_settings()
    assert settings.indexes == ("http://127.0.0.1:9/simple/",)
    assert settings.cert == "/some/ca.pem"


def test_no_index(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(carriers, "_pip_files", dict)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    assert carriers.pip_settings().indexes == ()
