"""From matched polygons to surface patches (paper 3.5.2): the polygon cloud."""

from zpm2.cloud.build import MatchedPair, build
from zpm2.cloud.holes import fill_holes
from zpm2.cloud.lift import Lifted, lift
from zpm2.cloud.neighbors import neighbor_pairs
from zpm2.cloud.patch import Cutter, SurfacePatch
from zpm2.cloud.rays import Hits, RayCaster, open_caster
from zpm2.cloud.result import CloudPatch, PolygonCloud
from zpm2.cloud.run import DisparityFile, from_stereo, from_workspace, read_rig
from zpm2.cloud.save import save
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.surface_path import SurfacePaths, trace_paths
from zpm2.cloud.surface_view import SurfaceView
from zpm2.cloud.workspace import PosedPhotograph, read_views

__all__ = [
    "CloudPatch",
    "Cutter",
    "DisparityFile",
    "Hits",
    "Lifted",
    "MatchedPair",
    "PolygonCloud",
    "PosedPhotograph",
    "RayCaster",
    "SurfaceMesh",
    "SurfacePatch",
    "SurfacePaths",
    "SurfaceView",
    "build",
    "fill_holes",
    "from_stereo",
    "from_workspace",
    "lift",
    "neighbor_pairs",
    "open_caster",
    "read_rig",
    "read_views",
    "save",
    "trace_paths",
]
