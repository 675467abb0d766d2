"""No command but `zpm2 weights` touches a network when `ZPM2_OFFLINE` is set, GDAL and PROJ included."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from listener import listening
from rendered import Pair, Run

# Takes lists of arguments as lines of JSON on standard input. Commands run one after the other in one process, as each
# new one would load everything again; what each says goes to a file of its number.
WATCHED = """
import contextlib, json, socket, sys, traceback

def refuse(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto"):
        sys.stderr.write(f"NETWORK {event} {arguments}\\n")
        raise RuntimeError("a test forbids the network")

sys.addaudithook(refuse)
from zpm2.cli import main
for number, line in enumerate(sys.stdin):
    sys.argv = ["zpm2", *json.loads(line)]
    with open(f"{number}.err", "w") as said, open(f"{number}.out", "w") as out:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
            try:
                main()
            except SystemExit as end:
                said.write(f"\\n{end.code}")
            except BaseException:
                traceback.print_exc()
"""
TRAPS = {
    "vrt": '<VRTDataset rasterXSize="64" rasterYSize="64"><VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
    '<SourceFilename relativeToVRT="0">/vsicurl/{url}/a.tif</SourceFilename><SourceBand>1</SourceBand></SimpleSource>'
    "</VRTRasterBand></VRTDataset>",
    "wms": "<GDAL_WMS><Service name='TMS'><ServerUrl>{url}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service></GDAL_WMS>",
}


def told(commands: list[list[str]], folder: Path, url: str) -> list[str]:
    """What each command says on standard error, and in the last line its exit code. In their process every call of
    Python's to a network is told and fails, and those of C libraries go to a proxy that counts them."""
    proxies = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"), url)
    proj = {"PROJ_NETWORK": "ON", "PROJ_NETWORK_ENDPOINT": url}
    kept = {name: value for name, value in os.environ.items() if name.lower() != "no_proxy"}
    places = {"ZPM2_WEIGHTS": "", "ZPM2_CACHE": str(folder / "cache"), "ZPM2_OFFLINE": "1", "ZPM2_ALLOW_VRT": ""}
    asked = "".join(json.dumps(command) + "\n" for command in commands)
    words, environment = [sys.executable, "-c", WATCHED], {**kept, **proxies, **proj, **places}
    done = subprocess.run(
        words, cwd=folder, env=environment, input=asked, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "NETWORK" not in done.stderr
    return [(folder / f"{number}.err").read_text() for number in range(len(commands))]


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


@pytest.fixture(scope="module")
def outcomes(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], list[object]]:
    """What each of `COMMANDS` says, and all calls to the proxy."""
    folder, files = tmp_path_factory.mktemp("offline"), (pair.left, pair.right, pair.left_regions, pair.right_regions)
    (folder / "pairs.csv").write_text(f"left,right\n{pair.left},{pair.right}\n")
    commands = [
        [word.format(*files) if word != "out" else f"out{number}" for word in command]
        for number, command in enumerate(COMMANDS)
    ]
    with listening() as calls:
        said = told(commands, folder, calls.address)
    return said, list(calls.calls)


@pytest.mark.parametrize("number", range(len(COMMANDS)), ids=lambda number: " ".join(COMMANDS[number][:2]))
def test_no_command_touches_a_network_when_offline(number: int, outcomes: tuple[list[str], list[object]]) -> None:
    """With good photographs; most end where weights are missing."""
    said, calls = outcomes
    text, _, code = said[number].rpartition("\n")
    assert "NETWORK" not in text
    assert "Traceback" not in text
    assert code.isdigit(), said[number]
    assert calls == []
    if "{2}" in COMMANDS[number]:
        assert code == "0", text


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
