"""Tiles that workers make: the result is the same as that of one process, to the last number."""

import json
from collections.abc import Callable, Generator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import wall
from rendered import Pair, Run
from test_engines import Here

import zpm2
from zpm2 import batch
from zpm2.batch.engines.engine import Engine
from zpm2.batch.job import Job
from zpm2.batch.results import Row
from zpm2.batch.supply import Supply
from zpm2.config import assign, preset
from zpm2.errors import ConfigError
from zpm2.model import Image

SETTINGS = ["device=cpu", "tiles.mode=on", "tiles.size=256", "guided.direction=off", "points.escalate.on=false"]
SETTINGS += ["points.methods=sift", "segment.model=classical"]
CONFIG = assign(preset("default"), SETTINGS)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    paths = wall.save_photographs(tmp_path_factory.mktemp("photographs"), 2)
    for path in paths:
        PIL.Image.open(path).resize((330, 241)).save(path)
    return [str(path) for path in paths]


def matched(photographs: list[str], kept: Path, workers: batch.TileEngine | None, said: list[str]) -> str:
    """All of the result but its seconds."""
    result = zpm2.Matcher(CONFIG, kept=kept, workers=workers, say=said.append)(*photographs)
    out = result.save(kept / "result", pictures=False)
    document = json.loads((out / "matches.json").read_text())
    assert len(document["matches"]) > 5
    return json.dumps({name: value for name, value in document.items() if name != "timings"})


@pytest.fixture(scope="module")
def alone(photographs: list[str], tmp_path_factory: pytest.TempPathFactory) -> str:
    return matched(photographs, tmp_path_factory.mktemp("alone"), None, [])


def on_ray() -> Engine:
    if find_spec("ray") is None:
        pytest.skip("needs the extra ray")
    return batch.RayEngine(2)


@pytest.mark.parametrize("engine", [Here, on_ray], ids=["here", "ray"])  # processes: on the command line
def test_the_same_result(engine: Callable[[], Engine], photographs: list[str], alone: str, tmp_path: Path) -> None:
    said = list[str]()
    assert matched(photographs, tmp_path, batch.TileEngine(engine()), said) == alone
    assert said == []  # no tile was left over, none is of an earlier run


def test_pages_of_a_tiff(photographs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rasterio")
    first, second = map(PIL.Image.open, photographs)
    first.save(tmp_path / "a.tif", save_all=True, append_images=[second])
    monkeypatch.chdir(tmp_path)
    pages, said = ["GTIFF_DIR:1:a.tif", "GTIFF_DIR:2:a.tif"], list[str]()
    assert matched(pages, tmp_path / "a", batch.TileEngine(Here()), said) == matched(pages, tmp_path / "b", None, [])
    assert said == []


def test_what_no_worker_can_make_is_left_to_the_run(photographs: list[str], alone: str, tmp_path: Path) -> None:
    class Broken(Here):
        def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
            while block := supply.next():
                yield from supply.lost(block, "its process ended by SIGKILL")

    said = list[str]()
    assert matched(photographs, tmp_path, batch.TileEngine(Broken(), retries=0), said) == alone
    assert said[0] == "tile 1-0 is left to the run itself: its process ended by SIGKILL"


def test_what_workers_cannot_see_is_refused(photographs: list[str], tmp_path: Path) -> None:
    workers = batch.TileEngine(Here())
    arrays = [np.asarray(PIL.Image.open(path)) for path in photographs]
    with pytest.raises(ConfigError, match="photographs that are files"):
        zpm2.Matcher(CONFIG, kept=tmp_path, workers=workers)(*arrays)
    named = [Image(pixels, path) for pixels, path in zip(arrays, photographs, strict=True)]
    with pytest.raises(ConfigError, match="photographs that are files"):
        zpm2.Matcher(CONFIG, kept=tmp_path, workers=workers)(*named)
    with pytest.raises(ConfigError, match="a folder for finished tiles"):
        zpm2.Matcher(CONFIG, workers=workers)(*photographs)

    class Own:
        name = "own"

        def segment(self, image: object) -> list[object]:
            return []

    with pytest.raises(ConfigError, match="name it instead"):
        zpm2.Matcher(CONFIG, segmenter=Own(), workers=workers)


def test_on_the_command_line(pair: Pair, run: Run, tmp_path: Path) -> None:
    words = ("match", pair.left, pair.right, *pair.regions, "--tiles", "on", "--set", "tiles.size=256", "-q")
    documents = []
    for name, more in (("alone", ()), ("spread", ("--workers", "2"))):
        code, _, err = run(*words, "-o", tmp_path / name, *more)
        assert code == 0, err
        document = json.loads((tmp_path / name / "matches.json").read_text())
        documents.append({key: value for key, value in document.items() if key != "timings"})
    assert documents[0] == documents[1]
    code, _, err = run(*words, "-o", tmp_path / "none", "--gpus", "1")
    assert (code, "give it, too" in err) == (2, True)
