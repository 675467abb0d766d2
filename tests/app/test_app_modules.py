"""The page's ES modules in Node."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import zpm2

NODE = shutil.which("node")
PACKAGE = Path(zpm2.__file__).parent

pytestmark = pytest.mark.skipif(NODE is None, reason="no node on this machine")


def test_modules(tmp_path: Path) -> None:
    """Beside those of the report, under the names that the server's import map gives them."""
    for name, room in (("report", "view/report"), ("app", "app")):
        shutil.copytree(PACKAGE / room / "page", tmp_path / name, ignore=shutil.ignore_patterns("package.json"))
    imports = {"#report/*": "./report/*", "#app/*": "./app/*"}
    (tmp_path / "package.json").write_text(json.dumps({"type": "module", "imports": imports}))
    shutil.copy(Path(__file__).with_name("page.test.js"), tmp_path)
    words = [str(NODE), "--test", str(tmp_path / "page.test.js")]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
