"""No command but `zpm2 weights` touches a network when `ZPM2_OFFLINE` is set, GDAL and PROJ included."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from listener import listening
from rendered import Pair, Run

WATCHED = """
import socket, sys

def refuse(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto"):
        sys.stderr.write(f"NETWORK {event} {arguments}\\n")
        raise RuntimeError("a test forbids the network")

sys.addaudithook(refuse)
from zpm2.cli import main
main()
"""
TRAPS = {
    "vrt": '<VRTDataset rasterXSize="64" rasterYSize="64"><VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
    '<SourceFilename relativeToVRT="0">/vsicurl/{url}/a.tif</SourceFilename><SourceBand>1</SourceBand></SimpleSource>'
    "</VRTRasterBand></VRTDataset>",
    "wms": "<GDAL_WMS><Service name='TMS'><ServerUrl>{url}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service></GDAL_WMS>",
}


def told(arguments: list[object], folder: Path, url: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, in which every call of Python's to a network is told and fails, and those of
    C libraries go to a proxy that counts them."""
    proxies = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"), url)
    proj = {"PROJ_NETWORK": "ON", "PROJ_NETWORK_ENDPOINT": url}
    kept = {name: value for name, value in os.environ.items() if name.lower() != "no_proxy"}
    words = [sys.executable, "-c", WATCHED, *map(str, arguments)]
    environment = {**kept, **proxies, **proj, "ZPM2_OFFLINE": "1"}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)


REGIONS = ["--left-regions", "{2}", "--right-regions", "{3}"]
COMMANDS = [
    ["match", "{0}", "{1}", "-o", "out", "--points", "sift", *REGIONS],
    ["match", "{0}", "{1}", "-o", "out", "--method", "shape-context", *REGIONS],
    ["match", "{0}", "{1}", "-o", "out"],
    ["pose", "{0}", "{1}", "-o", "out"],
    ["reconstruct", "{0}", "{1}", "-o", "out"],
    ["cloud", "--stereo", "{0}", "{1}", "-o", "out"],
    ["demo", "-o", "out"],
    ["eval", "csv", "--root", ".", "-o", "out"],
    ["config", "list"],
    ["doctor"],
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:2]))
def test_no_command_touches_a_network_when_offline(command: list[str], pair: Pair, tmp_path: Path) -> None:
    """With good photographs; most end where weights are missing."""
    (tmp_path / "pairs.csv").write_text(f"left,right\n{pair.left},{pair.right}\n")
    with listening() as calls:
        files = (pair.left, pair.right, pair.left_regions, pair.right_regions)
        done = told([word.format(*files) for word in command], tmp_path, calls.address)
    assert "NETWORK" not in done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    assert calls.calls == []
    if "{2}" in command:
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("kind", TRAPS)
def test_no_command_follows_a_file_to_a_network(
    kind: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rasterio")
    monkeypatch.chdir(tmp_path)
    PIL.Image.fromarray(np.zeros((64, 64), np.uint8)).save("good.png")
    with listening() as calls:
        Path("bad.tif").write_text(TRAPS[kind].format(url=calls.address))
        for name in ("bad.tif", f"WCS:{calls.address}", f"/vsicurl/{calls.address}/a.tif", f"{calls.address}/a.tif"):
            Path("pairs.csv").write_text(f"left,right\n{name},{name}\n")
            regions = "--segmenter", "precomputed", "--left-regions", name, "--right-regions", name
            for command in (
                ("match", name, "good.png"),
                ("match", "good.png", "good.png", *regions),
                ("pose", name, "good.png"),
                ("cloud", "--stereo", name, "good.png", "--K", "100,100,32,32", "--baseline", "1"),
                ("reconstruct", name, "good.png"),
            ):
                done = run(*command, "-o", "out")
                assert done.code == 2, done.err
                assert len(done.err.splitlines()) == 1, done.err
            run("eval", "csv", "--root", ".", "-o", "eval")
    assert calls.calls == []
