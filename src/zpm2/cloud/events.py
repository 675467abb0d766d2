"""Splits and merges on the surface: where a view has one region, another view has several."""

from collections.abc import Sequence

import numpy as np

from zpm2.cloud.patch import touching
from zpm2.cloud.result import CloudPatch
from zpm2.cloud.surface_view import SurfaceView
from zpm2.config import TracksConfig
from zpm2.tracking.events import Event, parts_of


def surface_events(
    patches: Sequence[CloudPatch],
    views: Sequence[SurfaceView],
    pairs: Sequence[tuple[int, int]],
    config: TracksConfig,
) -> list[Event]:
    """Those between the views of each of `pairs`, as `tracking.events` says; ids are those of patches, rows are views.

    A whole and its parts are patches of one place of the surface, which no view of the pair sees both. The parts fill
    the whole as the view with the parts sees them.
    """
    if not patches:
        return []
    surface = views[0].surface
    near = touching([each.patch for each in patches], surface)
    found: list[Event] = []
    for i, j in sorted({(min(pair), max(pair)) for pair in pairs}):
        for here, there in ((i, j), (j, i)):
            camera = views[there].camera
            for row, whole in enumerate(patches):
                if here not in whole.views or there in whole.views:
                    continue
                others = [patches[k] for k in sorted(near.get(row, []))]
                others = [each for each in others if there in each.views and here not in each.views]
                if len(others) < 2:
                    continue
                shapes = np.array([each.outline(camera, surface) for each in others], object)
                parts = parts_of(whole.outline(camera, surface), shapes, config)
                if len(parts) >= 2:
                    ids = tuple(sorted(others[k].id for k in parts))
                    found.append(Event("split" if here < there else "merge", whole.id, ids, here, there))
    return found
