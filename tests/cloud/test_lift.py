"""Polygons on surfaces that are known exactly: on the surface everywhere, closed, as large as they must be."""

import numpy as np
import pytest
import shapely
from meshes import distance_to, grid, sphere

from zpm2.cloud import SurfaceMesh, SurfaceView
from zpm2.cloud.lift import Lifted, SurfaceRing, lift, outline_in
from zpm2.cloud.rays import EveryTriangle
from zpm2.cloud.scaling import PolygonScaler, densified, rings_of
from zpm2.config import CloudConfig
from zpm2.errors import Failed
from zpm2.model import Camera, Polygon, PosedCamera

CAMERA = Camera(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), (640, 480))
DOWN = np.diag([1.0, -1, -1])  # looks along -z of the world
SQUARE = np.array([[220.0, 160], [430, 150], [440, 330], [230, 320]])
CONCAVE = np.array([[200.0, 150], [440, 150], [440, 330], [420, 330], [420, 170], [220, 170], [220, 330], [200, 330]])
HOLE = np.array([[300.0, 220], [300, 260], [350, 260], [350, 220]])


def above(height: float, offset: tuple[float, float, float] = (0, 0, 0)) -> PosedCamera:
    center = np.array([0.013, -0.007, height]) + offset
    return PosedCamera(CAMERA, DOWN, -DOWN @ center)


def lifted(surface: SurfaceMesh, polygon: Polygon, view: PosedCamera, **options: float) -> Lifted:
    on_surface = SurfaceView(view, surface, EveryTriangle(surface))
    (found,) = lift([polygon], on_surface, CloudConfig(**options))  # type: ignore[arg-type]
    assert isinstance(found, Lifted), found
    return found


def check_closed_on_surface(surface: SurfaceMesh, found: Lifted) -> None:
    for ring in found.rings:
        following = np.roll(ring.points, -1, axis=0)
        for p, q, face in zip(ring.points, following, ring.faces, strict=True):
            assert face >= 0
            assert distance_to(surface, face, p) < 1e-9 * surface.extent
            assert distance_to(surface, face, q) < 1e-9 * surface.extent


def area(found: Lifted) -> float:
    """Of a plane polygon, holes taken out, seen from above."""
    rings = [ring.points[:, :2] for ring in found.rings]
    return float(shapely.Polygon(rings[0], rings[1:]).area)


@pytest.mark.parametrize(("ring", "holes"), [(SQUARE, ()), (CONCAVE, ()), (SQUARE, (HOLE,))])
def test_on_a_plane(ring: np.ndarray, holes: tuple[np.ndarray, ...]) -> None:
    surface, polygon = grid(16, seed=3), Polygon(7, ring, holes)
    found = lifted(surface, polygon, above(2.0))
    assert (found.id, found.scale, found.bridged) == (7, 1.0, 0)
    assert len(found.rings) == 1 + len(holes)
    check_closed_on_surface(surface, found)
    assert area(found) == pytest.approx(polygon.area * (2.0 / 500) ** 2, rel=1e-5)
    sides = sum(np.linalg.norm(np.roll(r, -1, axis=0) - r, axis=1).sum() for r in (ring, *holes))
    assert found.length == pytest.approx(sides * 2.0 / 500, rel=1e-5)


def test_large_coordinates() -> None:
    offset = (431_000.5, 5_411_000.25, 310.0)
    near = grid(12, seed=1)
    far = SurfaceMesh.of(near.vertices + offset, near.faces)
    one = lifted(near, Polygon(0, SQUARE), above(2.0))
    other = lifted(far, Polygon(0, SQUARE), above(2.0, offset))
    assert np.abs(one.rings[0].points + near.origin - (other.rings[0].points + far.origin - offset)).max() < 1e-6
    check_closed_on_surface(far, other)


def test_on_a_sphere() -> None:
    surface, view = sphere(3), above(4.0)
    found = lifted(surface, Polygon(0, SQUARE * 0.5 + [160, 120]), view)
    assert found.scale == 1.0
    check_closed_on_surface(surface, found)
    back = view.project(found.rings[0].points + surface.origin)
    ring = shapely.LinearRing(SQUARE * 0.5 + [160, 120])
    assert shapely.distance(shapely.points(back), ring).max() < 1e-3  # seen from the camera it is the polygon


def step(n: int = 40) -> SurfaceMesh:
    """A block of height 0.5 over x < 0, with its vertical side."""
    height = np.where(np.linspace(-1, 1, n + 1) <= 1e-9, 0.5, 0.0)
    return grid(n, height=np.broadcast_to(height, (n + 1, n + 1)))


def test_the_background_does_not_bleed_in() -> None:
    """The polygon's right side hangs 20 px over the edge of the block: its naive corners lie on the ground."""
    surface, view = step(), above(3.0)
    edge = view.project(np.array([[0.0, 0, 0.5]]))[0, 0]
    polygon = Polygon(0, np.array([[150.0, 180], [edge + 20, 180], [edge + 20, 300], [150, 300]]))
    naive = EveryTriangle(surface).first_hits(
        np.broadcast_to(view.center - surface.origin, (4, 3)), view.directions(polygon.exterior)
    )
    heights = naive.point[:, 2] + surface.origin[2]
    assert heights.min() < 0.1
    found = lifted(surface, polygon, view)
    assert 0.5 < found.scale < 1
    height = found.rings[0].points[:, 2] + surface.origin[2]
    assert height.min() > 0.4  # at most the first pixel of the side
    assert np.mean(height > 0.499) > 0.7
    check_closed_on_surface(surface, found)


def test_what_cannot_be_lifted_says_why() -> None:
    surface = grid()
    view = SurfaceView(above(2.0), surface, EveryTriangle(surface))
    beyond = Polygon(0, SQUARE * 5 - 600)
    away = Polygon(1, SQUARE + np.array([3000, 0]))
    split = Polygon(2, np.array([[250.0, 180], [400, 180], [400, 300], [250, 300]]))
    found = lift([beyond, away, Polygon(3, SQUARE)], view, CloudConfig())
    assert isinstance(found[1], Failed)
    assert "leaves the surface" in found[1].reason
    assert isinstance(found[2], Lifted)
    block = step()
    (over,) = lift([split], SurfaceView(above(3.0), block, EveryTriangle(block)), CloudConfig(min_scale=0.9))
    assert isinstance(over, Failed)
    assert "jumps" in over.reason
    assert lift([], view, CloudConfig()) == []


def test_shrinking_stays_inside() -> None:
    for ring, holes, radial in ((SQUARE, (), True), (CONCAVE, (), False), (SQUARE, (HOLE,), False)):
        shape = shapely.Polygon(ring, holes)
        shrinker = PolygonScaler(shape)
        assert shrinker.radial is radial
        last = shape.area * 1.0001
        for scale in (1.0, 0.9, 0.7, 0.5):
            inner = shrinker.at(scale)
            assert shape.buffer(1e-6).contains(inner)
            assert inner.area < last
            last = inner.area
        assert shrinker.at(1.0) is shape


def test_densified() -> None:
    ring = densified(SQUARE, 2.0)
    assert np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).max() <= 2.0
    for corner in SQUARE:
        assert np.linalg.norm(ring - corner, axis=1).min() == 0
    assert shapely.distance(shapely.points(ring), shapely.LinearRing(SQUARE)).max() < 1e-9
    assert len(rings_of(shapely.Polygon())) == 0


def test_a_boundary_that_touches_itself_in_a_view_keeps_its_larger_part() -> None:
    corners = np.array([(4, 1), (7, 7), (6, 5), (5, 1), (6, 0), (7, 7)], float) / 10
    surface = grid(12)
    for way in (corners, corners[::-1]):
        ring = SurfaceRing(np.c_[way, np.zeros(len(way))] - surface.origin, np.zeros(len(way), np.int64))
        found = outline_in([ring], above(2.0), surface)
        assert found.is_valid
        assert found.area == pytest.approx(0.05 * (500 / 2.0) ** 2)
