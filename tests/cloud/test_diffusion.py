"""The part of a polygon on one surface, against one scale for all of it."""

import numpy as np
import pytest
import shapely
from meshes import grid
from test_lift import SQUARE, above, check_closed_on_surface, step

from zpm2.cloud import Lifted, SurfaceMesh, SurfaceView, lift, open_caster
from zpm2.cloud.diffusion import one_surface, without_discs
from zpm2.config import CloudConfig
from zpm2.model import Polygon

SCALE, PART = CloudConfig(diffusion="scale"), CloudConfig(diffusion="surface")


def over_the_edge() -> Polygon:
    """A tongue of it hangs over the edge of the block; the rest lies on the block."""
    edge = above(3.0).project(np.array([[0.0, 0, 0.5]]))[0, 0]
    ring = [[150, 150], [edge - 20, 150], [edge - 20, 220], [edge + 30, 220], [edge + 30, 240], [edge - 20, 240]]
    return Polygon(0, np.array([*ring, [edge - 20, 320], [150, 320]], np.float64))


def test_only_what_hangs_over_is_taken_away() -> None:
    surface, view, polygon = step(), above(3.0), over_the_edge()
    caster = open_caster(surface)
    (whole,), (part,) = (lift([polygon], SurfaceView(view, surface, caster), config) for config in (SCALE, PART))
    assert isinstance(whole, Lifted)
    assert isinstance(part, Lifted)
    edge = view.project(np.array([[0.0, 0, 0.5]]))[0, 0]
    kept = polygon.shape.intersection(shapely.box(0, 0, edge, 480))
    assert part.shape.area == pytest.approx(kept.area, rel=0.02)
    assert part.shape.difference(polygon.shape.buffer(1e-6)).area == 0
    assert whole.shape.area < 0.9 * part.shape.area  # one scale takes it all round
    for found in (whole, part):
        check_closed_on_surface(surface, found)
        height = found.rings[0].points[:, 2] + surface.origin[2]
        assert height.min() > 0.4  # nothing of the ground; a sample may meet the top of the wall
        assert np.mean(height > 0.499) > 0.9
    # what a plain projection of the corners gives
    corners = caster.first_hits(
        np.broadcast_to(view.center - surface.origin, (8, 3)), view.directions(polygon.exterior)
    )
    assert (corners.point[:, 2] + surface.origin[2] < 0.1).sum() == 2


def test_a_polygon_that_lies_on_one_surface_is_itself() -> None:
    surface = grid(16, seed=3)
    view = SurfaceView(above(2.0), surface, open_caster(surface))
    parts, spacings = one_surface([Polygon(0, SQUARE).shape], view, PART)

    assert parts[0].area == pytest.approx(Polygon(0, SQUARE).area, rel=1e-6)
    assert spacings[0] == pytest.approx(2.0 / 500, rel=0.05)


def test_holes_of_the_mesh_are_left_out() -> None:
    whole = grid(20)
    middle = np.abs(whole.corners.mean(1)[:, :2] - [0.3, 0]).max(1) < 0.25
    surface = SurfaceMesh.of(whole.vertices, whole.faces[~middle])
    (found,) = lift([Polygon(0, SQUARE)], SurfaceView(above(2.0), surface, open_caster(surface)), PART)
    assert isinstance(found, Lifted)
    assert found.bridged <= 0.02 * len(found.rings[0].points)  # at the rim of the hole
    assert 0.6 < found.scale < 1.0


def test_nothing_below() -> None:
    surface = grid(4, size=0.01)
    view = SurfaceView(above(2.0), surface, open_caster(surface))
    parts, spacings = one_surface([Polygon(0, SQUARE + 200).shape], view, PART)

    assert parts[0].is_empty
    assert spacings[0] == 0


def test_places_are_cut_out_of_the_boundary() -> None:
    square = shapely.box(0, 0, 100, 100)
    left = without_discs(square, np.array([[100.0, 50.0]]), 4.0, PART)
    assert 0 < square.area - left.area < 100
    assert left.distance(shapely.Point(100, 50)) >= 3.0
