"""Features of an encoder, averaged over regions."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from region_pairs import SIZE
from rings import generators, star

from zpm2.baselines.embeddings import Encoder, pooled
from zpm2.config import preset
from zpm2.errors import ConfigError
from zpm2.model import Image
from zpm2.polygons.rasterize import CELL_SAMPLES


def objects(*shapes):
    found = np.empty(len(shapes), object)
    found[:] = shapes
    return found


@given(generators, st.sampled_from([0.1, 0.25, 1.0]))
def test_the_mean_counts_each_sample_inside(rng, scale):
    features = rng.normal(size=(3, 8, 6))
    shape = shapely.Polygon(star(rng, 9, (3 / scale, 4 / scale), 2.5 / scale))
    sums, count = np.zeros(3), 0
    for row in range(8 * CELL_SAMPLES):
        for column in range(6 * CELL_SAMPLES):
            x, y = (column + 0.5) / CELL_SAMPLES / scale, (row + 0.5) / CELL_SAMPLES / scale
            if shape.contains(shapely.Point(x, y)):
                sums += features[:, row // CELL_SAMPLES, column // CELL_SAMPLES]
                count += 1
    found = pooled(features, scale, objects(shape))
    assert count
    assert np.allclose(found[0], sums / np.linalg.norm(sums))


def test_a_small_region_takes_the_cell_in_which_it_lies():
    features = np.random.default_rng(0).normal(size=(3, 4, 4))
    dot = shapely.box(21.01, 31.01, 21.02, 31.02)
    beyond = shapely.box(-9, 100, -5, 120)
    found = pooled(features, 0.1, objects(dot, beyond))
    for vector, cell in zip(found, (features[:, 3, 2], features[:, 3, 0]), strict=True):
        assert np.allclose(vector, cell / np.linalg.norm(cell))
    assert pooled(features, 0.1, objects()).shape == (0, 3)


class View:
    """A view with an embedding of 20 x 20 cells, one of a kind in each quarter."""

    embedding_scale = 0.1

    def __init__(self, constant):
        self.constant = constant

    def embedding(self):
        cells = np.zeros((4, 20, 20), np.float32)
        for k in range(4):
            cells[k, 10 * (k // 2) :, 10 * (k % 2) :][:10, :10] = 1
        return cells + np.float32(self.constant)


class Prompted:
    """A segmenter that takes prompts; its view is `view`."""

    name = "prompted"

    def __init__(self, view):
        self.known = view

    def segment(self, image):
        raise AssertionError("not asked for")

    def view(self, image):
        return self.known


class Plain:
    """A segmenter without views."""

    name = "plain"

    def segment(self, image):
        raise AssertionError("not asked for")


IMAGE = Image(np.zeros((SIZE, SIZE, 3), np.uint8), "x.png")
QUARTERS = objects(*(shapely.box(x, y, x + 99, y + 99) for y in (0, 100) for x in (0, 100)))


def encoder():
    return Encoder(preset("default"), lambda text: None, lambda done, total: None)


@pytest.mark.parametrize("constant", [0.0, 50.0])
def test_vectors_say_what_regions_do_not_have_in_common(constant):
    it = encoder()
    it.begin((IMAGE, IMAGE), (Prompted(View(constant)), Prompted(View(constant))))
    left, right = it.embed((QUARTERS, QUARTERS[::-1]))
    cosine = left @ right.T
    assert np.allclose(np.fliplr(np.eye(4)) * 4 / 3 - 1 / 3, cosine, atol=1e-4)
    assert it.notes == []


def test_a_segmenter_without_embeddings_is_helped_out_by_sam(monkeypatch):
    opened = []

    def create(config, device, say, download):
        opened.append(config.model)
        return Prompted(View(0))

    monkeypatch.setattr("zpm2.baselines.embeddings.create", create)
    it = encoder()
    it.begin((IMAGE, IMAGE), (Plain(), Plain()))
    assert it.notes == []
    it.embed((QUARTERS, QUARTERS))
    it.embed((QUARTERS, QUARTERS))
    assert opened == ["mobile_sam"]
    assert it.notes == ["regions embedded by mobile_sam: their own segmenter gives no embeddings"]


def test_no_segmenter_with_embeddings(monkeypatch):
    monkeypatch.setattr("zpm2.baselines.embeddings.create", lambda config, device, say, download: Plain())
    it = encoder()
    it.begin((IMAGE, IMAGE), (Plain(), Plain()))
    with pytest.raises(ConfigError, match="segmenter 'mobile_sam' gives no embeddings, which this method needs"):
        it.embed((QUARTERS, QUARTERS))
