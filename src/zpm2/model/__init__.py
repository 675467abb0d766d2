"""Plain data. Nothing here imports anything else of zpm2."""

from zpm2.model.camera import Camera, PosedCamera
from zpm2.model.georeference import Georeference
from zpm2.model.image import THIN, Image, thin
from zpm2.model.image_polygons import SIDES, ImagePolygons, SideName
from zpm2.model.mask import Mask
from zpm2.model.match import Counterpart, PolygonMatch, Stage, counterparts
from zpm2.model.points import PointMatches
from zpm2.model.polygon import Polygon, PolygonArrays, shapes_of, shapes_of_rings

__all__ = [
    "SIDES",
    "THIN",
    "Camera",
    "Counterpart",
    "Georeference",
    "Image",
    "ImagePolygons",
    "Mask",
    "PointMatches",
    "Polygon",
    "PolygonArrays",
    "PolygonMatch",
    "PosedCamera",
    "SideName",
    "Stage",
    "counterparts",
    "shapes_of",
    "shapes_of_rings",
    "thin",
]
