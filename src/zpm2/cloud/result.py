"""The polygon cloud: patches with their supporting matches, and the matches that gave no patch, with the reason."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array

from zpm2.cloud.lift import SurfaceRing, outline_in
from zpm2.cloud.patch import SurfacePatch, covered_shares
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.workspace import PosedPhotograph
from zpm2.files.photo_paths import photo_reference
from zpm2.files.writing import atomic_write
from zpm2.model import Polygon, PosedCamera
from zpm2.model.brief import brief
from zpm2.runtime import package_version
from zpm2.tracking.events import Event
from zpm2.view.palette import distinct_colors

Array = NDArray[np.float64]
SCHEMA = "zpm2-cloud/1"
BOX_OUTLIERS = 0.04  # share of all patches' px that the box leaves out at each end of each axis
BOX_MARGIN = 0.1  # share of the box's diagonal


@dataclass(frozen=True)
class SupportingMatch:
    """A match that supports a patch."""

    left_view: int
    right_view: int
    left_polygon: int  # id in that pair's result
    right_polygon: int
    confidence: float  # 0..1
    overlap: float  # 0..1, see `Agreement`
    distance: float | None  # units of the mesh

    @property
    def match(self) -> int:
        """Id of the match in that pair's result, as in its overlay (`PolygonMatch.id`)."""
        return self.left_polygon


@dataclass(frozen=True, eq=False)
class CloudPatch:
    """One polygon of the cloud: a closed piece of the surface and the matches that support it."""

    id: int
    patch: SurfacePatch  # in the surface's coordinates
    rings: tuple[SurfaceRing, ...]  # its boundary on the surface, exterior first
    view: int  # index of the view whose polygon was lifted
    polygon: Polygon  # that polygon, in the view's image
    scale: float  # s of the diffusion; 1 for the whole polygon
    bridged: int  # straight segments of the boundary, where no path along the surface exists
    views: tuple[int, ...]  # indices of all views that see it
    supports: tuple[SupportingMatch, ...]  # its matches, the most confident first
    filled: float  # 0..1, share of its area that lies on filled holes of the mesh
    parent: int | None = None  # id of the smallest patch that contains it
    level: int = 0  # number of patches that contain it

    __repr__ = brief

    @property
    def label(self) -> str | None:
        """The class name, if the source of the region gave one."""
        return self.polygon.label

    @property
    def confidence(self) -> float:
        """Confidence of its most confident match, 0..1."""
        return self.supports[0].confidence

    @property
    def length(self) -> float:
        """Total length of its boundaries, in units of the mesh."""
        return sum(ring.length for ring in self.rings)

    def outline(self, camera: PosedCamera, surface: SurfaceMesh) -> shapely.Geometry:
        """Its boundary projected into a camera, px; empty if part of it is behind the camera."""
        return outline_in(self.rings, camera, surface)


@dataclass(frozen=True)
class Rejected:
    """A match, or a track, that gave no patch."""

    left_view: int
    right_view: int
    left_polygon: int
    right_polygon: int
    reason: str

    @property
    def match(self) -> int:
        """Id of the match in that pair's result."""
        return self.left_polygon


@dataclass(frozen=True, eq=False)
class PolygonCloud:
    """The polygons on their surface."""

    views: Sequence[PosedPhotograph]
    surface: SurfaceMesh
    patches: Sequence[CloudPatch]
    rejected: Sequence[Rejected]
    matches: int  # number of matches of all pairs, before any was rejected
    coverage: float  # 0..1, share of the surface seen by the views that patches cover
    config: Mapping[str, object] = field(repr=False)
    timings: Mapping[str, float] = field(repr=False)  # stage -> seconds
    warnings: Sequence[str]  # what a user may have to act on
    notes: Sequence[str] = ()  # what was done automatically
    events: Sequence[Event] = ()  # splits and merges; ids are those of patches, rows are views
    version: str = field(default_factory=package_version, repr=False)

    __repr__ = brief

    @property
    def accepted(self) -> int:
        """Matches that support a patch."""
        return sum(len(patch.supports) for patch in self.patches)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """The lowest and the highest corner, (3,) each, of a box around most patches, in the surface's coordinates.

        Patches count by their px in the photographs, and the outermost few along each axis are left out: things far
        behind the scene are small in the photographs. Without patches, the box of the mesh.
        """
        if not self.patches:
            return self.surface.vertices.min(0), self.surface.vertices.max(0)
        middles = np.concatenate([p.patch.vertices[p.patch.faces].mean(1) for p in self.patches])
        weights = np.concatenate([p.patch.areas / p.patch.area * p.scale**2 * p.polygon.area for p in self.patches])
        low, high = np.empty(3), np.empty(3)
        for k in range(3):
            order = np.argsort(middles[:, k], kind="stable")
            share = np.cumsum(weights[order]) / weights.sum()
            low[k], high[k] = middles[order, k][np.searchsorted(share, [BOX_OUTLIERS, 1 - BOX_OUTLIERS])]
        margin = BOX_MARGIN * np.linalg.norm(high - low)
        return low - margin, high + margin

    @cached_property
    def covered_shares(self) -> csr_array:
        """Sparse (p, m): the share of each triangle of the surface that each patch covers."""
        return covered_shares([patch.patch for patch in self.patches], self.surface)

    @cached_property
    def colors(self) -> NDArray[np.uint8]:
        """(p, 3) RGB of the patches, each different from its neighbours."""
        centers = np.array([patch.patch.centroid for patch in self.patches]).reshape(-1, 3)
        reach = np.array([patch.patch.area**0.5 / 2 for patch in self.patches])
        return np.array(distinct_colors(centers, reach), np.uint8).reshape(-1, 3)

    def world(self, points: Array) -> Array:
        """Points (n, 3) of the surface, in the coordinates of the cameras and of the mesh's file."""
        return np.asarray(points + self.surface.origin)

    def reasons(self) -> dict[str, int]:
        """How many matches gave no patch, by reason, the most frequent first. Numbers in reasons are left out."""
        return dict(Counter(rejected.reason.split(":")[0] for rejected in self.rejected).most_common())

    def counts(self) -> dict[str, object]:
        """How many matches there were and what became of them."""
        return {
            "matches": self.matches,
            "accepted": self.accepted,
            "rejected": len(self.rejected),
            "patches": len(self.patches),
            "events": len(self.events),
            "coverage": self.coverage,
            "reasons": self.reasons(),
        }

    def to_dict(self) -> dict[str, object]:
        """The content of `cloud.json` (schema "zpm2-cloud/1"); coordinates, lengths and areas in units of the mesh."""
        surface = self.surface
        return {
            "schema": SCHEMA,
            "version": self.version,
            "config": dict(self.config),
            "timings": {stage: round(seconds, 4) for stage, seconds in self.timings.items()},
            "views": self._views(),
            "surface": {
                "vertices": len(surface.vertices),
                "faces": len(surface.faces),
                "filled_faces": surface.filled,
                "extent": surface.extent,
                "origin": surface.origin.tolist(),
                "notes": list(surface.notes),
            },
            "counts": self.counts(),
            "patches": [self._patch(patch) for patch in self.patches],
            "events": [vars(event) | {"parts": list(event.parts)} for event in self.events],
            "rejected": [{"match": rejected.match, **vars(rejected)} for rejected in self.rejected],
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def _views(self) -> list[dict[str, object]]:
        return [
            {
                "name": view.name,
                "path": str(view.path),
                "camera": view.camera.camera.to_dict(),
                "rotation": view.camera.rotation.tolist(),
                "translation": view.camera.translation.tolist(),
            }
            for view in self.views
        ]

    def _patch(self, polygon: CloudPatch) -> dict[str, object]:
        patch = polygon.patch
        return {
            "id": polygon.id,
            "label": polygon.label,
            "confidence": polygon.confidence,
            "parent": polygon.parent,
            "area": patch.area,
            "length": polygon.length,
            "centroid": self.world(patch.centroid[None])[0].tolist(),
            "normal": patch.normal.tolist(),
            "normal_spread_deg": patch.normal_spread,
            "planarity": patch.planarity,
            "plane_distance": patch.plane_distance,
            "curvature": patch.curvature,
            "triangles": len(patch.faces),
            "scale": polygon.scale,
            "filled": polygon.filled,
            "bridged": polygon.bridged,
            "view": polygon.view,
            "views": list(polygon.views),
            "supports": [{"match": support.match, **vars(support)} for support in polygon.supports],
            "rings": [self.world(ring.points).tolist() for ring in polygon.rings],
        }

    def save_json(self, folder: Path) -> Path:
        """Write cloud.json: the whole file or none."""
        references = [photo_reference(str(view.path), folder) for view in self.views]
        views = [view | reference for view, reference in zip(self._views(), references, strict=True)]
        return atomic_write(folder / "cloud.json", json.dumps(self.to_dict() | {"views": views}, allow_nan=False))
