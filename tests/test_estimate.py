"""How much memory pairs take, and what the budget makes of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from rendered import Pair, Run

import zpm2
from zpm2 import config, estimate, memory
from zpm2.baselines import BaselineMatcher
from zpm2.errors import InputError
from zpm2.features import METHODS
from zpm2.pipeline import PairMatcher
from zpm2.segment.registry import SEGMENTERS

MEASURED = {  # MiB, see estimate.MEMORY
    "default": {1: 1775, 4: 1833, 12: 2019, 25: 2449},
    "paper": {1: 1474, 4: 1488, 12: 1588, 25: 2115},
}


def square(megapixels: float) -> tuple[int, int]:
    side = round((megapixels * 1e6) ** 0.5)
    return side, side


def own(pair: Pair) -> dict[str, str]:
    return {"left_regions": str(pair.left_regions), "right_regions": str(pair.right_regions)}


@pytest.mark.parametrize("name", MEASURED)
def test_estimates_are_above_what_was_measured_and_not_far(name: str) -> None:
    for megapixels, measured in MEASURED[name].items():
        estimated = estimate.whole(config.preset(name), [square(megapixels)] * 2, False) / 2**20
        assert measured < estimated < 2.2 * measured


def test_every_method_and_model_has_its_number() -> None:
    assert all(method.info.bytes_per_pixel > 0 for method in METHODS.values())
    assert all(segmenter.info.working_bytes > 0 for segmenter in SEGMENTERS.values())


def test_200_megapixels_need_much_more_as_a_whole_than_in_tiles() -> None:
    sizes = [square(200)] * 2
    assert estimate.whole(config.preset("paper"), sizes, False) > 20.7e9
    assert estimate.in_tiles(config.preset("default"), sizes, 0, False) < 3e9


def large(path: Path, side: int = 15000) -> Path:
    """An empty photograph of 225 megapixels in a few kB."""
    rasterio = pytest.importorskip("rasterio")
    kind = {"driver": "GTiff", "width": side, "height": side, "count": 3, "dtype": "uint8"}
    with rasterio.open(path, "w", sparse_ok=True, tiled=True, compress="deflate", **kind):
        pass
    return path


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_a_large_pair_is_refused_as_a_whole_before_anything_is_loaded(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zpm2.guided.regions.RegionFinder.load", lambda self: pytest.fail("networks were loaded"))
    photograph = large(tmp_path / "a.tif")
    words = [photograph, photograph, "-o", tmp_path / "out"]
    code, _, err = run("match", *words, "--preset", "paper", "--max-memory", "8GB")
    assert code == 2
    assert "a pair of 15000 x 15000 px as a whole needs about" in err
    assert "the budget is 8.0 GB (--max-memory 8GB): match it in tiles (--tiles auto)" in err
    assert not (tmp_path / "out").exists()
    code, _, err = run("match", *words, "--max-memory", "1GB")
    assert code == 2
    assert "in tiles of 2048 px needs about" in err
    for command in ("pose", "cloud"):
        more = ["--K", "guess", *(["--stereo", "--baseline", "1"] if command == "cloud" else [])]
        code, _, err = run(command, *words, *more, "--max-memory", "500MB")
        assert (code, "needs about 1.1 GB of memory" in err) == (2, True), err


def test_a_small_budget_chooses_tiles_says_so_and_changes_nothing_where_there_is_enough(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(estimate.MEMORY, "pixel", 30_000.0)  # so that it is the pixels that need it
    options = {"points": "sift", "device": "cpu", **own(pair)}
    chosen = replace(config.preset("default"), tiles=config.TilesConfig(mode="auto", size=256))
    asked = config.with_options(chosen, {"points": "sift"})
    sizes = [(pair.scene.left.shape[1], pair.scene.left.shape[0])] * 2
    needs = estimate.in_tiles(asked, sizes, pair.scene.left.nbytes * 2, True), estimate.whole(asked, sizes, True)
    between = f"{sum(needs) / 2e6:.0f}MB"
    small = zpm2.match(pair.left, pair.right, chosen, max_memory=between, **options)
    assert "stitch" in small.timings
    assert any(w.startswith("matched in tiles, as it needs about") and between in w for w in small.warnings)
    enough = zpm2.match(pair.left, pair.right, chosen, max_memory="100GB", **options)
    usual = zpm2.match(pair.left, pair.right, chosen, max_memory="none", **options)
    assert "stitch" not in usual.timings
    documents = [{k: v for k, v in r.to_dict().items() if k not in ("timings", "config")} for r in (enough, usual)]
    assert documents[0] == documents[1]
    with pytest.raises(InputError, match="as a whole needs about"):
        zpm2.match(pair.left, pair.right, chosen, tiles="off", max_memory=between, **options)
    with pytest.raises(InputError, match="as a whole needs about"):
        PairMatcher(replace(chosen, max_memory=between))(pair.left, pair.right)
    with pytest.raises(InputError, match="as a whole needs about"):
        BaselineMatcher("idsc", replace(chosen, max_memory=between))(pair.left, pair.right)


@pytest.mark.parametrize("command", ["match", "pose", "cloud", "demo", "eval", "reconstruct"])
def test_every_command_refuses_what_is_no_size(command: str, run: Run, pair: Pair, tmp_path: Path) -> None:
    words: dict[str, list[object]] = {
        "match": [pair.left, pair.right],
        "pose": [pair.left, pair.right],
        "cloud": [tmp_path],
        "demo": [],
        "eval": ["pairs", "--root", tmp_path],
        "reconstruct": [tmp_path],
    }
    code, _, err = run(command, *words[command], "-o", tmp_path / "out", "--max-memory", "8")
    assert (code, "max_memory '8' is no size" in err) == (2, True)
    assert not (tmp_path / "out").exists()


def test_the_budget_of_a_command_ends_with_it(run: Run, tmp_path: Path) -> None:
    before = memory.whose()
    run("match", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "out", "--max-memory", "1MB")
    assert memory.whose() == before


def test_reconstruct_asks_before_it_reads(run: Run, tmp_path: Path) -> None:
    PIL.Image.fromarray(np.zeros((4000, 3000, 3), np.uint8)).save(tmp_path / "a.png")
    code, _, err = run("reconstruct", tmp_path, "-o", tmp_path / "out", "--max-memory", "50MB")
    assert code == 2
    assert "needs about 156 MB of memory, the budget is 50.0 MB" in err
