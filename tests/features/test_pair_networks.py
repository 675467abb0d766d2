"""Matchers that see two images at once: what is around their networks, and the real networks with random weights."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import PointsConfig
from zpm2.errors import MissingDependency, WeightsError
from zpm2.features import METHODS, PointMatcher, create, seen_size
from zpm2.features import efficientloftr_network as efficient
from zpm2.features.pair_network import BATCH, PairNetworkMatcher
from zpm2.features.protocol import Features
from zpm2.model import Image, PointMatches

Answer = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
FOUND = PointsConfig(loftr_threshold=0.0, min_score=0.0, superpoint_threshold=0.0, max_keypoints=200)


def image(width: int, height: int, seed: int = 0) -> Image:
    """Noise: something to see in every place."""
    return Image(np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8))


# What is around a network


class Recorded:
    """A network that answers with the same points for every pair, and remembers what it saw."""

    def __init__(self, left: list[list[float]], right: list[list[float]], scores: list[float]) -> None:
        self.answer = torch.tensor(left).view(-1, 2), torch.tensor(right).view(-1, 2), torch.tensor(scores)
        self.seen: list[tuple[torch.Size, torch.Size]] = []

    def __call__(self, left: torch.Tensor, right: torch.Tensor) -> list[Answer]:
        self.seen.append((left.shape, right.shape))
        return [self.answer] * len(left)


def around(network: Recorded, **changes: int) -> PairNetworkMatcher:
    return PairNetworkMatcher("recorded", network, PointsConfig(**changes), "cpu")


def test_points_come_back_in_px_of_the_images() -> None:
    """The left image is seen at half its size: px (10.5, 20) of what the network sees, corners at 0, is (21, 40)."""
    network = Recorded([[10.5, 20.0]], [[30.25, 7.5]], [0.7])
    found = around(network, max_size=160).match(image(320, 256), image(160, 64))
    assert network.seen == [((1, 3, 128, 160), (1, 3, 64, 160))]
    np.testing.assert_allclose(found.left, [[21.0, 40.0]])
    np.testing.assert_allclose(found.right, [[30.25, 7.5]])
    np.testing.assert_allclose(found.score, [0.7], rtol=1e-6)


def test_points_on_padding_and_on_blank_areas_go() -> None:
    right = image(100, 70).rgb.copy()
    right[:, :40] = 128
    network = Recorded([[50, 50], [110, 50], [50, 50]], [[80, 30], [80, 30], [10, 30]], [0.5, 0.9, 0.9])
    found = around(network).match(image(100, 70), Image(right))
    assert found.left.tolist() == [[50, 50]]


def test_the_best_points_stay() -> None:
    at = [[20.0 + k, 30.0] for k in range(6)]
    network = Recorded(at, at, [0.1, 0.6, 0.3, 0.6, 0.2, 0.9])
    found = around(network, max_keypoints=3).match(image(96, 64), image(96, 64))
    assert found.left[:, 0].tolist() == [25, 21, 23]


def test_nothing_found() -> None:
    network = Recorded([], [], [])
    assert len(around(network).match(image(64, 64), image(64, 64))) == 0
    assert around(network).match_many([]) == []


def test_pairs_of_equal_sizes_are_seen_together() -> None:
    sizes = [(96, 64)] * (BATCH + 2) + [(64, 96)] * 2 + [(96, 64)]
    network = Recorded([[30, 30]], [[30, 30]], [0.5])
    found = around(network).match_many([(image(*size), image(*size)) for size in sizes])
    assert [len(each) for each in found] == [1] * len(sizes)
    assert [left[0] for left, _ in network.seen] == [BATCH, 2, 2, 1]


def test_large_pairs_are_seen_one_by_one() -> None:
    network = Recorded([], [], [])
    large = Image(np.zeros((832, 832, 3), np.uint8))
    around(network).match_many([(large, large)] * 3)
    assert [left[0] for left, _ in network.seen] == [1, 1, 1]


def test_the_size_that_a_matcher_was_trained_for() -> None:
    assert seen_size(PointsConfig(methods=("xfeat",))) == 1600
    assert seen_size(PointsConfig(methods=("loftr-outdoor",))) == 840
    assert seen_size(PointsConfig(methods=("sift", "loftr-indoor"))) == 640
    assert seen_size(PointsConfig(methods=("loftr-outdoor",), max_size=500)) == 500
    assert seen_size(PointsConfig(methods=("loftr-outdoor",), trained_size=False)) == 1600
    assert seen_size(PointsConfig(methods=("not.here:Any",))) == 1600


# The real networks, with random weights that are saved and loaded as the real ones are


@cache
def random_loftr() -> dict[str, torch.Tensor]:
    from kornia.feature import LoFTR

    torch.manual_seed(0)
    return {f"matcher.{key}": value for key, value in LoFTR(None).state_dict().items()}


@cache
def random_efficientloftr() -> dict[str, torch.Tensor]:
    package = pytest.importorskip("transformers", reason="the extra hf is not installed")
    torch.manual_seed(0)
    network = package.EfficientLoFTRForKeypointMatching(package.EfficientLoFTRConfig())
    for values in network.parameters():
        if values.ndim > 1:  # as it comes, all places look alike
            torch.nn.init.kaiming_normal_(values)
    return dict(network.state_dict())


@cache
def random_superglue() -> dict[str, torch.Tensor]:
    package = pytest.importorskip("transformers", reason="the extra hf is not installed")
    torch.manual_seed(0)
    return dict(package.SuperGlueForKeypointMatching(package.SuperGlueConfig()).state_dict())


RANDOM: dict[str, Callable[[], dict[str, torch.Tensor]]] = {
    "loftr-outdoor": random_loftr,
    "loftr-indoor": random_loftr,
    "efficientloftr": random_efficientloftr,
    "superglue-outdoor": random_superglue,
    "superglue-indoor": random_superglue,
}


def file_of(method: str) -> str:
    """The file of the network that pairs."""
    return weights.entry(METHODS.get(method).info.weights[-1]).file


def save(path: Path, state: dict[str, torch.Tensor]) -> None:
    if path.suffix == ".safetensors":
        from safetensors.torch import save_file

        save_file({key: value.clone().contiguous() for key, value in state.items()}, path)
    else:
        torch.save({"state_dict": state} if path.suffix == ".ckpt" else state, path)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder of weights, with a SuperPoint of random weights, of which we then know no hash; licences that
    forbid commercial use are accepted."""
    from zpm2.features.superpoint_network import SuperPoint

    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("ZPM2_WEIGHTS", str(tmp_path))
    monkeypatch.setenv("ZPM2_OFFLINE", "1")
    manifest = tuple(replace(e, size=0, sha256="") if e.name == "superpoint" else e for e in weights.MANIFEST)
    for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
        monkeypatch.setattr(f"{module}.MANIFEST", manifest)
    torch.manual_seed(1)
    save(tmp_path / "superpoint_v1.pth", SuperPoint().state_dict())
    accepted = {e.licence for e in manifest if not e.commercial_use}
    (tmp_path / "cache" / "weights").mkdir(parents=True)
    (tmp_path / "cache" / "weights" / "accepted-licences.txt").write_text("\n".join(sorted(accepted)))
    return tmp_path


@pytest.fixture(params=RANDOM)
def matcher(request: pytest.FixtureRequest, folder: Path) -> PointMatcher:
    method: str = request.param
    save(folder / file_of(method), RANDOM[method]())
    return create(replace(FOUND, methods=(method,)))


def check_form(found: PointMatches, left: Image, right: Image) -> None:
    for at, side in ((found.left, left), (found.right, right)):
        assert at.shape == (len(found), 2)
        assert at.dtype == np.float64
        assert ((at >= 0) & (at <= [side.width, side.height])).all()
    assert found.score.shape == (len(found),)
    assert ((found.score >= 0) & (found.score <= 1)).all()


def close(a: PointMatches, b: PointMatches) -> None:
    """Whatever their order: scores of random weights are equal but for rounding."""
    one, other = (np.c_[each.left, each.right, each.score][np.lexsort(each.left.round(1).T)] for each in (a, b))
    np.testing.assert_allclose(one, other, atol=1e-3)


def test_real_networks(matcher: PointMatcher) -> None:
    left, right = image(96, 96), image(128, 64, 1)
    found = matcher.match(left, right)
    check_form(found, left, right)
    assert len(found) <= 200
    again = matcher.match(left, right)
    for name in ("left", "right", "score"):
        assert getattr(again, name).tobytes() == getattr(found, name).tobytes()
    same = matcher.match(left, left)
    assert len(same) > 0
    for size in ((1, 1), (5, 100)):
        small = image(*size)
        check_form(matcher.match(small, small), small, small)
    blank = Image(np.full((60, 70, 3), 127, np.uint8))
    assert len(matcher.match(blank, left)) == len(matcher.match(left, blank)) == 0
    if matcher.name == "efficientloftr":
        return  # random weights see every place alike, so that rounding chooses: see below
    crops = [(image(96, 96, k), image(96, 96, k + 1)) for k in range(2)]
    for together, alone in zip(matcher.match_many(crops), [matcher.match(*pair) for pair in crops], strict=True):
        close(together, alone)


@pytest.mark.parametrize("method", ["loftr-outdoor", "efficientloftr", "superglue-indoor"])
def test_files_that_do_not_fit_are_refused_in_one_line(method: str, folder: Path) -> None:
    state, file = RANDOM[method](), folder / file_of(method)
    first = next(iter(state))
    bare = first.removeprefix("matcher.")

    def refused(text: str) -> None:
        with pytest.raises(WeightsError, match=text) as raised:
            create(replace(FOUND, methods=(method,)))
        assert "\n" not in str(raised.value)

    save(file, {**{k: v for k, v in state.items() if k != first}, "renamed.weight": state[first]})
    refused(f"do not fit this network: the file lacks {bare}; has besides renamed.weight$")
    save(file, {**state, first: torch.zeros(1, 2, 3)})
    refused(f"do not fit this network: the file has in another shape {bare}$")
    save(file, {"some.weight": torch.zeros(2)})
    refused(r"do not fit this network: the file lacks .* and \d+ more; has besides some.weight$")
    save(file, state)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    refused("cannot be read as weights")
    file.write_bytes(b"<!doctype html><title>404</title>" * 20)
    refused("cannot be read as weights")
    file.unlink()
    refused("ZPM2_OFFLINE is set")


@pytest.mark.parametrize("method", ["efficientloftr", "superglue-outdoor"])
def test_without_the_extra(method: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(
        MissingDependency,
        match=r'^point method \'[a-z-]+\' needs transformers( and [a-z]+)?: pip install "zpm2\[hf\]"$',
    ):
        create(PointsConfig(methods=(method,)))


def test_superglue_asks_for_its_licence(folder: Path) -> None:
    save(folder / file_of("superglue-outdoor"), RANDOM["superglue-outdoor"]())
    (folder / "cache" / "weights" / "accepted-licences.txt").unlink()
    with pytest.raises(WeightsError, match="--accept-licence"):
        create(PointsConfig(methods=("superglue-outdoor",)))


# Efficient LoFTR's points, beside a loop that says the same


def coarse_loop(
    left: NDArray[np.float64], right: NDArray[np.float64], threshold: float
) -> list[tuple[int, int, float]]:
    channels, height, width = left.shape
    a, b = left.reshape(channels, -1) / 16, right.reshape(channels, -1) / 16
    exp = np.exp(a.T @ b / 0.1)
    confidence = exp / exp.sum(0) * exp / exp.sum(1, keepdims=True)
    inner = [y * width + x for y in range(2, height - 2) for x in range(2, width - 2)]
    return [
        (i, j, confidence[i, j])
        for i in inner
        for j in inner
        if confidence[i, j] > threshold and confidence[i, j] == confidence[i].max() == confidence[:, j].max()
    ]


def test_coarse_matches_are_cells_that_are_each_others_best() -> None:
    random = np.random.default_rng(0)
    left = random.standard_normal((256, 10, 12)) * 3
    order = random.permutation(120)
    right = left.reshape(256, 120)[:, order].reshape(256, 10, 12) + random.standard_normal((256, 10, 12)) * 2
    i, j, confidence = efficient.coarse_matches(torch.from_numpy(left), torch.from_numpy(right), 0.2)
    expected = coarse_loop(left, right, 0.2)
    assert len(expected) > 10
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == [(a, b) for a, b, _ in expected]
    np.testing.assert_allclose(confidence, [c for *_, c in expected])
    assert (order[j] == i.numpy()).all()


def test_efficientloftr_sees_pairs_together_as_it_sees_them_alone() -> None:
    """A network that answers with made-up maps, by the number in the first pixel."""
    random = torch.Generator().manual_seed(0)
    coarse = torch.randn(3, 2, 256, 8, 12, generator=random) * 3
    coarse[:, 1] = coarse[:, 0].roll((1, 2), (2, 3)) + torch.randn(3, 256, 8, 12, generator=random)
    windows = [torch.randn(3, 96, pixels, 64, generator=random) * 3 for pixels in (64, 100)]
    asked: list[torch.Tensor] = []

    def maps(pairs: torch.Tensor) -> SimpleNamespace:
        asked.append(pairs[:, 0, 0, 0, 0].long())
        return SimpleNamespace(feature_maps=(coarse[asked[-1]],))

    network = SimpleNamespace(
        efficientloftr=maps, refinement_layer=lambda maps, finer: [each[asked[-1]] for each in windows]
    )
    pixels = torch.arange(3.0)[:, None, None, None].expand(3, 1, 64, 96)
    together = efficient.match(network, pixels, pixels, 0.2)
    for k, found in enumerate(together):
        (alone,) = efficient.match(network, pixels[k : k + 1], pixels[k : k + 1], 0.2)
        assert len(found[0]) > 5
        assert (found[1] - found[0] - torch.tensor([16.0, 8.0])).abs().max() <= 9
        for one, other in zip(found, alone, strict=True):
            torch.testing.assert_close(one, other)


def refine_loop(left: NDArray[np.float64], right: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    """Of one match: (64, c) and (100, c)."""
    exp = np.exp(left[:, :-8] @ right[:, :-8].T / left.shape[1])
    fits = (exp / exp.sum(0) * exp / exp.sum(1, keepdims=True)).reshape(64, 10, 10)
    a, y, x = max(np.ndindex(64, 8, 8), key=lambda at: fits[at[0], at[1] + 1, at[2] + 1])
    heat = {}
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            place = ((y + dy) % 10) * 10 + (x + dx) % 10
            heat[dx, dy] = np.exp(left[a, -8:] @ right[place, -8:] / 8**0.5 / 10)
    total = sum(heat.values())
    move = [sum(step[k] * value for step, value in heat.items()) / total for k in (0, 1)]
    return [a % 8 - 3.5, a // 8 - 3.5], [x - 3.5 + move[0], y - 3.5 + move[1]]


def test_refined_points() -> None:
    random = np.random.default_rng(0)
    left, right = random.standard_normal((5, 64, 64)) * 3, random.standard_normal((5, 100, 64)) * 3
    found = efficient.refine(torch.from_numpy(left), torch.from_numpy(right))
    expected = [refine_loop(a, b) for a, b in zip(left, right, strict=True)]
    for side in (0, 1):
        np.testing.assert_allclose(found[side], [each[side] for each in expected], atol=1e-9)


def test_superglue_is_that_of_transformers_where_both_images_have_as_many_points(folder: Path) -> None:
    from zpm2.features.superglue import SuperGlueMatcher

    package = pytest.importorskip("transformers", reason="the extra hf is not installed")
    save(folder / file_of("superglue-outdoor"), random_superglue())
    matcher = SuperGlueMatcher("superglue_outdoor", package, "cpu")
    random = np.random.default_rng(0)

    def features() -> Features:
        descriptors = random.standard_normal((40, 256)).astype(np.float32)
        at = random.random((40, 2)) * [320, 240]
        return Features(at, descriptors / np.linalg.norm(descriptors, axis=1)[:, None], random.random(40), (320, 240))

    a, b = features(), features()
    both = [torch.from_numpy(np.stack([getattr(a, n), getattr(b, n)])[None]).float() for n in ("points", "descriptors")]
    scores = torch.from_numpy(np.stack([a.scores, b.scores])[None]).float()
    with torch.inference_mode():
        matches, confidence, *_ = matcher.network._match_image_pair(*both, scores, 240, 320)
    rows, found = matcher.pair(a, b)
    expected = torch.nonzero(matches[0, 0] >= 0)[:, 0]
    assert rows[:, 0].tolist() == expected.tolist()
    assert rows[:, 1].tolist() == matches[0, 0][expected].tolist()
    np.testing.assert_allclose(found, confidence[0, 0][expected], atol=1e-5)
