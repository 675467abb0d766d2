"""From matched polygons to surface patches (paper 3.5.2). So far: the surface, its rays, and walks along it."""

from zpm2.cloud.rays import Hits, RayCaster, open_caster
from zpm2.cloud.surface import Surface
from zpm2.cloud.walk import Walks, walk

__all__ = ["Hits", "RayCaster", "Surface", "Walks", "open_caster", "walk"]
