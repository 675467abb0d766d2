"""The polygon cloud as files that other programs open: PLY, GLB, GeoJSON, WKT, coloured points."""

import io
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import memory
from zpm2.cloud.result import CloudPatch, PolygonCloud
from zpm2.cloud.surface import SurfaceMesh, require_trimesh
from zpm2.config import recorded
from zpm2.errors import ConfigError, MissingDependency
from zpm2.files.writing import atomic_write
from zpm2.formats import geojson
from zpm2.photos.images import read_image

if TYPE_CHECKING:
    from trimesh import Trimesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Colors = NDArray[np.uint8]
TUBE_RADIUS = 0.0015  # radius of the tubes around boundaries, as a share of the extent
TUBE_SIDES = 6  # sides of a tube's cross-section
BOUNDARY_SHADE = 0.45  # brightness of a boundary, as a share of its patch's
MOST_POINTS = 2**31 - 1  # of a file: programs count them in 32 bits
POINT_BYTES = 400  # of memory for each sampled point
FRAME = "coordinates of the cameras and of the mesh"


def tubes(rings: Sequence[Array], radius: float) -> tuple[Array, Indices]:
    """Vertices and triangles of tubes around closed lines of (k, 3) points, in the same coordinates."""
    points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    angles = np.linspace(0, 2 * np.pi, TUBE_SIDES, endpoint=False)
    for line in rings:
        ring = _thinned(line, radius)
        n = len(ring)
        if n < 3:
            continue
        along = np.roll(ring, -1, axis=0) - np.roll(ring, 1, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        across = np.cross(along, np.eye(3)[np.abs(along).argmin(1)])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
        up = np.cross(along, across)
        around = np.cos(angles)[:, None] * across[:, None] + np.sin(angles)[:, None] * up[:, None]
        points.append((ring[:, None] + radius * around).reshape(-1, 3))
        at = np.arange(n * TUBE_SIDES).reshape(n, TUBE_SIDES)
        a, b = at, np.roll(at, -1, axis=1)
        # the corners may rotate from one ring of the tube to the next: join each ring where it fits best
        shift = _fit(around, np.roll(around, -1, axis=0))
        following = np.roll(at, -1, axis=0)
        rows = np.arange(n)[:, None]
        c = following[rows, (np.arange(TUBE_SIDES) + shift[:, None]) % TUBE_SIDES]
        d = following[rows, (np.arange(TUBE_SIDES) + 1 + shift[:, None]) % TUBE_SIDES]
        quads = np.concatenate([np.stack([a, b, d], axis=2), np.stack([a, d, c], axis=2)]).reshape(-1, 3)
        faces.append(quads + count)
        count += n * TUBE_SIDES
    return np.concatenate(points), np.concatenate(faces)


def write_ply(cloud: PolygonCloud, path: Path) -> Path:
    """All patches as one binary PLY in double precision. Each face has its colour, its normal and its patch's id."""
    patches = [patch.patch for patch in cloud.patches]
    start = np.cumsum([0, *(len(p.vertices) for p in patches)])
    vertices = cloud.world(np.concatenate([np.zeros((0, 3)), *(p.vertices for p in patches)]))
    count = [len(p.faces) for p in patches]
    face = np.zeros(
        sum(count),
        [("n", "u1"), ("v", "<i4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3), ("patch", "<i4")],
    )
    face["n"] = 3
    if patches:
        face["v"] = np.concatenate([p.faces + first for p, first in zip(patches, start, strict=False)])
        face["normal"] = np.concatenate([p.normals for p in patches])
        face["rgb"] = np.repeat(cloud.colors, count, axis=0)
        face["patch"] = np.repeat([p.id for p in cloud.patches], count)
    header = [
        *_ply_header(len(vertices)),
        f"element face {len(face)}",
        "property list uchar int vertex_indices",
        *(f"property float {name}" for name in ("nx", "ny", "nz")),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "property int patch",
        "end_header\n",
    ]
    return atomic_write(path, "\n".join(header).encode() + vertices.astype("<f8").tobytes() + face.tobytes())


def check_spacing(cloud: PolygonCloud, spacing: float | None) -> None:
    """`ConfigError` where points `spacing` apart (units of the mesh; None: about 200,000 points) would be too many."""
    most = min(memory.budget() / POINT_BYTES, MOST_POINTS)
    least = (sum(polygon.patch.area for polygon in cloud.patches) / max(most, 1.0)) ** 0.5
    if spacing and not spacing >= least:
        raise ConfigError(
            f"spacing {spacing:g} makes more points than the {most:.2g} that memory and files hold: "
            f"give {1.1 * least:.2g} or more"
        )


def write_points(cloud: PolygonCloud, spacing: float, *paths: Path) -> int:
    """Write points on the patches, about `spacing` apart, as .ply or .las (needs the package laspy).

    Each point has the colour that its patch's photograph shows there, and the patch's id. A point on nested patches
    belongs to the innermost one. Returns the number of points.
    """
    points, rgb, patch = sampled(cloud, spacing)
    for path in paths:
        atomic_write(path, (_las if path.suffix == ".las" else _points_ply)(points, rgb, patch))
    return len(points)


def _points_ply(points: Array, rgb: Colors, patch: Indices) -> bytes:
    rows = np.zeros(len(points), [("at", "<f8", 3), ("rgb", "u1", 3), ("patch", "<i4")])
    rows["at"], rows["rgb"], rows["patch"] = points, rgb, patch
    header = [
        *_ply_header(len(points)),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "property int patch",
        "end_header\n",
    ]
    return "\n".join(header).encode() + rows.tobytes()


def sampled(cloud: PolygonCloud, spacing: float) -> tuple[Array, Colors, Indices]:
    """The points of `write_points`: (n, 3) world coordinates, (n, 3) RGB and (n,) patch ids."""
    generator, raster = np.random.default_rng(0), recorded(cloud.config).raster  # the bands that were matched
    parts: dict[int, list[CloudPatch]] = {}
    for polygon in cloud.patches:
        if polygon.parent is not None:
            parts.setdefault(polygon.parent, []).append(polygon)
    points, rgb, ids = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)], [np.zeros(0, np.int64)]
    for view in sorted({p.view for p in cloud.patches}):
        camera = cloud.views[view].camera
        image = read_image(cloud.views[view].path, config=raster)
        for polygon in (p for p in cloud.patches if p.view == view):
            patch = polygon.patch
            number = max(1, round(patch.area / spacing**2))
            face = generator.choice(len(patch.faces), number, p=patch.areas / patch.area)
            weights = generator.dirichlet([1.0, 1.0, 1.0], number)
            on_patch = np.einsum("nk,nki->ni", weights, patch.vertices[patch.faces[face]])
            at = cloud.world(on_patch)
            seen = np.nan_to_num(camera.project(at))
            for part in parts.get(polygon.id, []):  # points on a nested patch belong to that patch
                inside = shapely.contains_xy(part.outline(camera, cloud.surface), seen)
                at, seen = at[~inside], seen[~inside]
            points.append(at)
            column, row = seen.astype(np.int64).T
            rgb.append(image.rgb[np.clip(row, 0, image.height - 1), np.clip(column, 0, image.width - 1)])
            ids.append(np.full(len(at), polygon.id))
    return np.concatenate(points), np.concatenate(rgb), np.concatenate(ids)


def write_glb(cloud: PolygonCloud, path: Path) -> Path:
    """Write a GLB scene: a node for each polygon ("polygon 7", with its attributes as extras) and one for its boundary.

    GLB stores single precision, so coordinates are relative to "origin" in the scene's extras. The axes are the mesh's.
    """
    trimesh = require_trimesh()
    scene = trimesh.Scene(metadata={"origin": cloud.surface.origin.tolist(), "schema": "zpm2-cloud/1"})
    low, high = cloud.box
    radius = TUBE_RADIUS * float(np.linalg.norm(high - low))
    for polygon, rgb in zip(cloud.patches, cloud.colors, strict=True):
        mesh = _coloured(trimesh, polygon.patch.vertices, polygon.patch.faces, rgb)
        mesh.metadata = attributes(polygon)
        scene.add_geometry(mesh, node_name=f"polygon {polygon.id}", geom_name=f"polygon {polygon.id}")
        tube = tubes([ring.points for ring in polygon.rings], radius)
        if len(tube[1]):
            line = _coloured(trimesh, *tube, (rgb * BOUNDARY_SHADE).astype(np.uint8))
            scene.add_geometry(line, node_name=f"boundary {polygon.id}", geom_name=f"boundary {polygon.id}")
    return atomic_write(path, scene.export(file_type="glb"))


def attributes(polygon: CloudPatch) -> dict[str, object]:
    """The attributes of a polygon, without its geometry."""
    patch = polygon.patch
    return {
        "id": polygon.id,
        "label": polygon.label,
        "confidence": round(polygon.confidence, 4),
        "parent": polygon.parent,
        "area": patch.area,
        "length": polygon.length,
        "planarity": round(patch.planarity, 5),
        "curvature": patch.curvature,
        "normal": [round(float(x), 5) for x in patch.normal],
        "scale": round(polygon.scale, 4),
        "views": list(polygon.views),
        "matches": [
            {"match": support.match, "left_view": support.left_view, "right_view": support.right_view}
            for support in polygon.supports
        ],
    }


def write_boundaries(cloud: PolygonCloud, folder: Path) -> list[Path]:
    """Write the boundaries in the coordinates of the cameras, without a reference system.

    boundaries.geojson has the polygons with heights. boundaries.wkt has a line per polygon: id, tab, POLYGON Z.
    """
    features = [
        {
            "type": "Feature",
            "id": polygon.id,
            "properties": attributes(polygon),
            "geometry": {"type": "Polygon", "coordinates": [r.tolist() for r in _closed(cloud, polygon)]},
        }
        for polygon in cloud.patches
    ]
    collection = {"type": "FeatureCollection", "coordinate_frame": FRAME, "crs": None, "features": features}
    lines = []
    for polygon in cloud.patches:
        rings = _closed(cloud, polygon)
        shape = shapely.Polygon(rings[0], rings[1:])
        lines.append(f"{polygon.id}\t{shapely.to_wkt(shape, rounding_precision=-1, output_dimension=3)}\n")
    return [
        geojson.write(folder / "boundaries.geojson", collection),
        atomic_write(folder / "boundaries.wkt", "".join(lines)),
    ]


def write_surface(surface: SurfaceMesh, path: Path) -> Path:
    """A mesh as binary PLY in double precision, in the coordinates of the cameras."""
    face = np.zeros(len(surface.faces), [("n", "u1"), ("v", "<i4", 3)])
    face["n"], face["v"] = 3, surface.faces
    header = [
        *_ply_header(len(surface.vertices)),
        f"element face {len(face)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    vertices = (surface.vertices + surface.origin).astype("<f8")
    return atomic_write(path, "\n".join(header).encode() + vertices.tobytes() + face.tobytes())


def require_laspy() -> ModuleType:
    """The package laspy. `MissingDependency` if it is not installed."""
    try:
        import laspy
    except ImportError as error:
        raise MissingDependency('LAS files need laspy: pip install "zpm2[las]"') from error
    return laspy


def _las(points: Array, rgb: Colors, patch: Indices) -> bytes:
    laspy = require_laspy()
    header = laspy.LasHeader(point_format=7, version="1.4")
    low = points.min(0) if len(points) else np.zeros(3)
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 1.0
    header.offsets, header.scales = low, np.full(3, max(extent, 1e-9) / 2e9)
    header.add_extra_dim(laspy.ExtraBytesParams(name="patch", type=np.int32))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.red, las.green, las.blue = rgb.T.astype(np.uint16) * 257
    las.patch = patch.astype(np.int32)
    buffer = io.BytesIO()
    las.write(buffer)
    return buffer.getvalue()


def _ply_header(vertices: int) -> list[str]:
    return [
        "ply",
        "format binary_little_endian 1.0",
        "comment zpm2 polygon cloud",
        f"element vertex {vertices}",
        *(f"property double {axis}" for axis in "xyz"),
    ]


def _coloured(trimesh: ModuleType, vertices: Array, faces: Indices, rgb: Colors) -> "Trimesh":
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.visual.face_colors = [*rgb.tolist(), 255]
    return mesh


def _closed(cloud: PolygonCloud, polygon: CloudPatch) -> list[Array]:
    """The rings in world coordinates, with the first point repeated at the end."""
    return [cloud.world(np.concatenate([ring.points, ring.points[:1]])) for ring in polygon.rings]


def _thinned(ring: Array, step: float) -> Array:
    """A closed line with fewer points: the first one in each interval of length `step` along it."""
    along = np.cumsum(np.linalg.norm(np.diff(ring, axis=0, append=ring[:1]), axis=1))
    return ring[np.unique(np.floor(along / step), return_index=True)[1]]


def _fit(first: Array, second: Array) -> Indices:
    """(n,) how many corners to turn each second ring by, so that its corners lie next to those of the first."""
    agreement = [np.einsum("nki,nki->n", first, np.roll(second, -k, axis=1)) for k in range(TUBE_SIDES)]
    return np.argmax(agreement, axis=0)
