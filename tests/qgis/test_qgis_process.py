"""The plug-in in QGIS itself (qgis_process, without a window); skipped where there is no QGIS."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

QGIS = shutil.which("qgis_process.bin") or shutil.which("qgis_process")  # Debian's script gives .bin a wrong option
ROOT = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.skipif(QGIS is None, reason="qgis_process is not on PATH"),
    pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for the command is a shell script"),
]
Process = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def process(tmp_path: Path) -> Process:
    """qgis_process with the plug-in, in a profile of its own, with this zpm2 on PATH."""
    (tmp_path / "bin").mkdir()
    script = tmp_path / "bin" / "zpm2"
    script.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT / "src"}" exec "{sys.executable}" -m zpm2 "$@"\n')
    script.chmod(0o755)
    environment = {
        "PATH": f"{script.parent}{os.pathsep}/usr/bin:/bin",
        "HOME": str(tmp_path),
        "LANG": "C.UTF-8",
        "QT_QPA_PLATFORM": "offscreen",
        "QGIS_PLUGINPATH": str(ROOT / "qgis"),
    }

    def call(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(QGIS), *words], env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
        )

    assert "Enabled" in call("plugins", "enable", "zpm2_processing").stdout
    return call


def layer(path: Path, shift: float) -> None:
    """Houses of different size on the ground."""
    features = []
    for k in range(40):
        x, y = 500_000 + 30 * (k % 8) + 7 * (k * k % 3) + shift, 5_000_000 + 30 * (k // 8) + 5 * (k * k % 5) - shift
        a, b = 6 + k * 7 % 11, 5 + k * 5 % 9
        ring = [[x, y], [x + a, y], [x + a, y + b], [x, y + b], [x, y]]
        geometry = {"type": "Polygon", "coordinates": [ring]}
        features.append({"type": "Feature", "properties": {"name": f"house {k}"}, "geometry": geometry})
    crs = {"type": "name", "properties": {"name": "EPSG:32633"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))


def test_link_and_load(process: Process, tmp_path: Path) -> None:
    for name, shift in (("a", 0.0), ("b", 2.0)):
        layer(tmp_path / f"{name}.geojson", shift)
    inputs = (f"LEFT_LAYER={tmp_path / 'a.geojson'}", f"RIGHT_LAYER={tmp_path / 'b.geojson'}")
    done = process("run", "zpm2:link", "--", *inputs, f"OUTPUT={tmp_path / 'out'}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "40 links of 40 and 40 polygons" in done.stdout
    assert f"REGIONS:\t{tmp_path / 'out' / 'regions.geojson'}" in done.stdout
    loaded = process("run", "zpm2:load", "--", f"FOLDER={tmp_path / 'out'}")
    assert f"SHIFTS:\t{tmp_path / 'out' / 'shifts.geojson'}" in loaded.stdout


def test_the_error_of_the_command_is_that_of_the_algorithm(process: Process, tmp_path: Path) -> None:
    layer(tmp_path / "a.geojson", 0.0)
    inputs = (f"LEFT_LAYER={tmp_path / 'a.geojson'}", f"RIGHT_LAYER={tmp_path / 'a.geojson'}")
    failed = process("run", "zpm2:link", "--", *inputs, "EXTRA=--set link.nothing=1", f"OUTPUT={tmp_path / 'out'}")
    assert failed.returncode != 0
    assert "unknown option 'link.nothing'" in failed.stderr
    assert "Traceback" not in failed.stdout + failed.stderr
    empty = process("run", "zpm2:load", "--", f"FOLDER={tmp_path}")
    assert "has no layers of zpm2" in empty.stderr
