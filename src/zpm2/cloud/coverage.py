"""How much of the surface that the views see is covered by patches."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.patch import SurfacePatch, covered_shares
from zpm2.cloud.surface_view import SurfaceView
from zpm2.errors import InputError

BLIND = 0.01  # a camera may be wrong if a smaller share of its image meets the mesh
UNSEEN = "no view sees the mesh: give a mesh and cameras of the same scene, in the same coordinates"


class Coverage:
    """What views see of a surface, sampled by a grid of about `rays` rays per view. `InputError` if none sees it."""

    def __init__(self, views: Sequence[SurfaceView], rays: int) -> None:
        self.surface = views[0].surface
        self._faces: list[NDArray[np.int64]] = []
        self._shares: list[float] = []
        for view in views:
            hits = view.cast_grid(rays)
            self._faces.append(hits.face[hits.found])
            self._shares.append(float(hits.found.mean()))
        if not any(self._shares):
            raise InputError(UNSEEN)

    def warnings(self, names: Sequence[str]) -> list[str]:
        """A warning that names the views that hardly see the mesh: their cameras may be wrong."""
        blind = [name for name, share in zip(names, self._shares, strict=True) if share < BLIND]
        return [f"{', '.join(blind)}: less than 1 % of the image meets the mesh"] if blind else []

    def of(self, patches: Sequence[SurfacePatch]) -> float:
        """Share of all hits that lie on patches, 0..1; 0 if there are no hits."""
        hit = np.concatenate([np.zeros(0, np.int64), *self._faces])
        if len(hit) == 0 or not patches:
            return 0.0
        covered = np.asarray(covered_shares(patches, self.surface).sum(axis=0)).ravel()
        return float(np.minimum(covered[hit], 1.0).mean())
