"""Views: what they show, and their points in px of the originals."""

import numpy as np
import pytest

from zpm2.features.views import to_originals, view
from zpm2.geometry import project
from zpm2.model import Image, PointMatches


@pytest.mark.parametrize("angle", [0, 45, -135, 90, 180, 33.3])
@pytest.mark.parametrize("size", [80, 160, 500])
def test_a_view_shows_what_its_matrix_says(angle: float, size: int) -> None:
    """A picture of two ramps: red is the column, green the row."""
    y, x = np.indices((120, 160))
    image = Image(np.dstack([x, y, 0 * x]).astype(np.uint8))
    seen = view(image, size, angle)
    height, width = seen.image.rgb.shape[:2]
    rows, columns = np.indices((height, width)) + 0.5
    at = project(seen.to_original, np.c_[columns.ravel(), rows.ravel()]).reshape(height, width, 2)
    inner = ((at > 4) & (at < [156, 116])).all(2)
    assert inner.sum() > 0.6 * 160 * 120 * min(1, size / 160) ** 2
    assert np.abs(seen.image.rgb[inner][:, :2] - (at[inner] - 0.5)).max() < 1.51
    corners = project(np.linalg.inv(seen.to_original), np.array([[0.0, 0], [160, 0], [160, 120], [0, 120]]))
    assert corners.min() > -1e-6
    assert (corners < np.array([width, height]) + 1e-6).all()


def test_points_of_views_are_those_of_their_originals() -> None:
    left, right = Image(np.zeros((120, 160, 3), np.uint8)), Image(np.zeros((90, 200, 3), np.uint8))
    a, b = view(left, 80), view(right, 150, 70)
    at = np.array([[10.0, 20.0], [100.0, 50.0]])
    seen = PointMatches(
        project(np.linalg.inv(a.to_original), at), project(np.linalg.inv(b.to_original), at), np.ones(2)
    )
    found = to_originals(seen, a, b)
    assert found.left == pytest.approx(at)
    assert found.right == pytest.approx(at)
    assert found.score is seen.score
