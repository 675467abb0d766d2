"""Labelme's JSON: one photograph, with a list of shapes.

Coordinates are ours: x, y in px from the outer corner of the top-left pixel. Labelme turns photographs by their EXIF
orientation, we do not.
"""

import base64
import io
import json
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import PIL.Image

from zpm2.errors import InputError
from zpm2.files.photo_paths import photo_reference
from zpm2.files.reading import read_bytes
from zpm2.files.writing import atomic_write
from zpm2.formats import geojson
from zpm2.formats.convert import Members
from zpm2.formats.properties import plain
from zpm2.formats.regions.outlines import cropped, one_ring, pixels_of
from zpm2.formats.regions.region import (
    CarriedRegion,
    GivenRegion,
    GivenRegions,
    Photograph,
    Shape,
    check_size,
    counted,
    name_of,
    other_photograph,
    ours,
    placed,
    without_ours,
)
from zpm2.model import Mask
from zpm2.photos.pictures import DAMAGE

VERSION = "5.5.0"  # of Labelme, whose format this is
GEOMETRY = {"label", "points", "shape_type", "mask"}  # members of a shape that are no properties
CIRCLE_VERTICES = 64  # of a circle: its area is 0.2 % too small


@dataclass(frozen=True, eq=False)
class Labelme:
    """The parsed file."""

    path: Path
    data: Members
    complete = False

    def read(self, photograph: Photograph) -> GivenRegions:
        """One region for each shape with an area: polygon, rectangle, circle or mask."""
        notes = other_photograph(self.data.get("imagePath"), photograph)
        size = self.data.get("imageWidth"), self.data.get("imageHeight")
        if isinstance(size[0], int) and isinstance(size[1], int):
            check_size(str(self.path), (size[0], size[1]), photograph)
        found, lines = [], 0
        for row, shape in enumerate(self.data["shapes"]):
            name = f"shape {row} of {self.path}"
            if not isinstance(shape, dict):
                raise InputError(f"{name} is not an object: correct the file")
            body = _body(shape, name, photograph)
            if body is None:
                lines += 1
                continue
            label = shape.get("label")
            properties = plain({key: value for key, value in shape.items() if key not in GEOMETRY})
            text = None if label is None else plain(str(label))
            found.append(GivenRegion(body, None, None, 1.0, text, properties, row))
        if lines:
            notes.append(f"{counted(lines, 'shape')} without an area (points, lines) left out")
        return GivenRegions(found, notes)

    def names(self, stem: str) -> tuple[str, ...]:
        """One file."""
        return (f"{stem}.json",)

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """The same shapes: masks as masks, all others as polygons. Several pieces and holes are joined into one ring
        (`one_ring`), as Labelme's polygons have neither. `imagePath` leads from the written file to the photograph;
        `imageData` holds its content where the given file held that of the old one."""
        shapes = []
        for each, shape in placed(carried):
            given = self.data["shapes"][each.region.row]
            shapes.append(without_ours(given) | _outline(each.region, shape, photograph) | ours(each.attributes))
        where = photo_reference(photograph.path, path.parent)["relative_path"] or name_of(photograph)
        content = _content(photograph) if self.data.get("imageData") else None
        size = {"imageHeight": photograph.height, "imageWidth": photograph.width}
        document = self.data | {"shapes": shapes, "imagePath": where, "imageData": content} | size
        atomic_write(path, json.dumps(plain(document), ensure_ascii=False, indent=2))
        return []


def begin(regions: Sequence[GivenRegion], labels: Sequence[str]) -> Labelme:
    """A document of its own (`region.Begin`), with the photograph in it, as Labelme writes them."""
    shapes = [
        {"label": region.label, "group_id": None, "description": "", "flags": {}}
        | {key: value for key, value in region.properties.items() if key not in GEOMETRY}
        for region in regions
    ]
    embedded = {"imageData": True}  # `write` puts the photograph there
    return Labelme(Path(), {"version": VERSION, "flags": {}, "shapes": shapes, **embedded})


def _content(photograph: Photograph) -> str | None:
    """The photograph's file in base64; None where Labelme could not show it."""
    if photograph.path is None or Path(photograph.path).suffix.lower() not in (".jpg", ".jpeg", ".png"):
        return None
    try:
        return base64.b64encode(read_bytes(Path(photograph.path))).decode("ascii")
    except OSError:  # moved away
        return None


def is_labelme(data: object) -> bool:
    """Whether a JSON value has the form of a Labelme file."""
    return isinstance(data, dict) and isinstance(data.get("shapes"), list) and "imagePath" in data


def _body(shape: Members, name: str, photograph: Photograph) -> Mask | tuple[geojson.Rings, ...] | None:
    kind, points = shape.get("shape_type") or "polygon", shape.get("points")
    if kind in ("point", "points", "line", "linestrip"):
        return None
    if not isinstance(points, list):
        raise InputError(f"{name} has no list of points: correct the file")
    vertices = geojson.ring(points, name)
    if kind in ("polygon", "oriented_rectangle"):
        return ([vertices],)
    if kind == "rectangle" and len(vertices) == 4:  # as some programs write them
        return ([vertices],)
    if len(vertices) != 2 or kind not in ("rectangle", "circle", "mask"):
        raise InputError(f"{name} is a '{str(kind)[:40]}' of {counted(len(vertices), 'point')}: correct the file")
    (x0, y0), (x1, y1) = vertices.tolist()
    if kind == "mask":
        return _mask(shape.get("mask"), round(x0), round(y0), name, photograph)
    if kind == "rectangle":
        return ([np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])],)
    angles = 2 * np.pi * np.arange(CIRCLE_VERTICES) / CIRCLE_VERTICES
    return ([vertices[0] + math.hypot(x1 - x0, y1 - y0) * np.column_stack([np.cos(angles), np.sin(angles)])],)


def _mask(text: object, x0: int, y0: int, name: str, photograph: Photograph) -> Mask:
    """A mask from a PNG in base64, whose first pixel is (x0, y0); cut at the photograph's borders."""
    try:
        if not isinstance(text, str):
            raise ValueError("it is no text")
        content = io.BytesIO(base64.b64decode(text, validate=True))
        with warnings.catch_warnings(action="ignore"), PIL.Image.open(content, formats=["PNG"]) as picture:
            if picture.width > photograph.width or picture.height > photograph.height:
                raise ValueError("it is larger than the photograph")
            bits = np.asarray(picture.convert("L")) != 0
    except (*DAMAGE, PIL.Image.DecompressionBombError) as error:
        raise InputError(f"{name} has a mask that is not a PNG of its crop: write the file anew") from error
    left, top = max(0, -x0), max(0, -y0)
    right, bottom = max(left, photograph.width - x0), max(top, photograph.height - y0)
    return cropped(Mask(x0 + left, y0 + top, bits[top:bottom, left:right]))


def _outline(region: GivenRegion, shape: Shape, photograph: Photograph) -> Members:
    if not isinstance(region.body, Mask):
        return {"points": one_ring(shape).tolist(), "shape_type": "polygon"}
    mask = pixels_of(shape, photograph)
    rows, columns = max(1, mask.bits.shape[0]), max(1, mask.bits.shape[1])
    bits = mask.bits if mask.bits.size else np.zeros((1, 1), bool)
    out = io.BytesIO()
    PIL.Image.fromarray(bits.astype(np.uint8) * 255).save(out, "PNG")
    return {
        "points": [[mask.x0, mask.y0], [mask.x0 + columns - 1, mask.y0 + rows - 1]],
        "shape_type": "mask",
        "mask": base64.b64encode(out.getvalue()).decode("ascii"),
    }
