"""The one rule for which pixel lies inside a polygon, against a loop over pixels."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapes import star

from zpm2.polygons import rasterize as module
from zpm2.polygons.rasterize import rasterize, rasterize_stack

SIZE = 40, 30


def reference(shape: shapely.Geometry, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixel by pixel: is the centre, moved by a hair to the right and down, in the shape?"""
    xs, ys = np.arange(size[0]) + 0.5 + 1e-9, np.arange(size[1]) + 0.5 + 1e-7
    return np.array([[shape.contains(shapely.Point(x, y)) for x in xs] for y in ys])


@pytest.mark.parametrize(
    "shape",
    [
        shapely.box(3, 4, 7, 7),
        shapely.box(3.5, 4.5, 7.5, 7.5),
        shapely.box(0, 0, *SIZE),
        shapely.box(-20, -5, 60, 12.2),
        shapely.box(100, 100, 120, 120),
        shapely.box(5, 5, 30, 25).difference(shapely.box(10, 10, 20.3, 20.7)),
        shapely.union_all([shapely.box(1, 1, 5, 5), shapely.box(20, 8.2, 33.3, 29)]),
        shapely.Point(17.3, 12.1).buffer(9.7),
        shapely.Polygon(),
    ],
)
@pytest.mark.parametrize("few_cells", [0, 1000], ids=["line by line", "cell by cell"])
def test_a_stack_is_the_loop_over_pixels(
    monkeypatch: pytest.MonkeyPatch, few_cells: int, shape: shapely.Geometry
) -> None:
    monkeypatch.setattr(module, "FEW_CELLS", few_cells)
    other = shapely.Point(9, 9).buffer(4)
    bits = rasterize_stack(np.array([other, shape, other], object), SIZE)
    assert np.array_equal(bits[1], reference(shape, SIZE))
    assert np.array_equal(bits[0], bits[2])
    assert np.array_equal(bits[0], reference(other, SIZE))


def test_no_shapes_make_an_empty_stack() -> None:
    assert rasterize_stack(np.zeros(0, object), SIZE).shape == (0, 30, 40)


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_a_stack_holds_the_crops_of_its_shapes(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    rings = [star(rng, 9, rng.uniform(-10, 60, 2), float(rng.uniform(1, 30))) for _ in range(count)]
    shapes = np.array([s for s in map(shapely.Polygon, rings) if s.is_valid], object)
    for bits, shape in zip(rasterize_stack(shapes, SIZE), shapes, strict=True):
        mask, whole = rasterize(shape), np.zeros((300, 300), bool)
        height, width = mask.bits.shape
        whole[100 + mask.y0 : 100 + mask.y0 + height, 100 + mask.x0 : 100 + mask.x0 + width] = mask.bits
        assert np.array_equal(bits, whole[100 : 100 + SIZE[1], 100 : 100 + SIZE[0]])
