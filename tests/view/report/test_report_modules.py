"""The page's ES modules in Node."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import zpm2.view.report

PAGE = Path(zpm2.view.report.__file__).parent / "page"
NODE = shutil.which("node")

pytestmark = pytest.mark.skipif(NODE is None, reason="no node on this machine")


def test_modules() -> None:
    words = [str(NODE), "--test", str(Path(__file__).with_name("modules.test.js"))]
    done = subprocess.run(words, env={**os.environ, "PAGE": str(PAGE)}, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
