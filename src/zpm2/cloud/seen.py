"""What views see of a surface, and how much of that patches cover."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.patch import Patch, shares
from zpm2.cloud.rays import Hits, RayCaster
from zpm2.cloud.surface import Surface
from zpm2.cloud.trial import cast
from zpm2.errors import InputError
from zpm2.model import PosedCamera

PROBES = 20_000  # rays of each view
UNSEEN = "no view sees the mesh: give mesh and cameras of one scene, in the same coordinates"


def probe(camera: PosedCamera, surface: Surface, caster: RayCaster, count: int) -> Hits:
    """The first hits of about `count` rays, on a grid over the image."""
    width, height = camera.camera.size
    step = max((width * height / count) ** 0.5, 1.0)
    x, y = np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, height, step))
    return cast(camera, surface, caster, np.c_[x.ravel(), y.ravel()])


class Seen:
    """What views see of a surface, by a grid of rays each. `InputError` where none sees it."""

    def __init__(self, surface: Surface, caster: RayCaster, cameras: Sequence[PosedCamera]) -> None:
        self.surface = surface
        self._hit: list[NDArray[np.int64]] = []
        self._seen: list[float] = []
        for camera in cameras:
            hits = probe(camera, surface, caster, PROBES)
            self._hit.append(hits.face[hits.found])
            self._seen.append(float(hits.found.mean()))
        if not any(self._seen):
            raise InputError(UNSEEN)

    def warnings(self, names: Sequence[str]) -> list[str]:
        """Views that hardly see the mesh: their cameras may be wrong."""
        blind = [name for name, share in zip(names, self._seen, strict=True) if share < 0.01]
        return [f"{', '.join(blind)}: less than 1 % of the image meets the mesh"] if blind else []

    def covered(self, patches: Sequence[Patch]) -> float:
        """0..1, the share of all hits that lies on patches; 0 without hits."""
        hit = np.concatenate([np.zeros(0, np.int64), *self._hit])
        if len(hit) == 0 or not patches:
            return 0.0
        covered = np.asarray(shares(patches, self.surface).sum(axis=0)).ravel()
        return float(np.minimum(covered[hit], 1.0).mean())
