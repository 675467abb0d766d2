"""From matched polygons to surface patches (paper 3.5.2). So far: surfaces, rays, walks, polygons lifted by them."""

from zpm2.cloud.lift import Lifted, lift
from zpm2.cloud.patch import Cutter, Patch
from zpm2.cloud.rays import Hits, RayCaster, open_caster
from zpm2.cloud.surface import Surface
from zpm2.cloud.walk import Walks, walk

__all__ = [
    "Cutter",
    "Hits",
    "Lifted",
    "Patch",
    "RayCaster",
    "Surface",
    "Walks",
    "lift",
    "open_caster",
    "walk",
]
