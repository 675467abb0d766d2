"""CVAT's XML, "CVAT for images 1.1": a list of photographs with their shapes.

Coordinates are ours: x, y in px from the outer corner of the top-left pixel.
"""

import json
import math
import re
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from zpm2 import memory
from zpm2.errors import InputError
from zpm2.files.reading import read_text
from zpm2.files.writing import atomic_write
from zpm2.formats import geojson, run_lengths
from zpm2.formats.properties import plain
from zpm2.formats.regions.outlines import cropped, one_ring, pixels_of
from zpm2.formats.regions.region import (
    PREFIX,
    CarriedRegion,
    GivenRegion,
    GivenRegions,
    Photograph,
    Shape,
    check_size,
    counted,
    name_of,
    of_photograph,
    other_photograph,
    ours,
    placed,
)
from zpm2.model import Mask

Element = ElementTree.Element

AREAS = ("polygon", "box", "ellipse", "mask")  # elements that have an area
OTHERS = ("polyline", "points", "cuboid", "skeleton", "tag")
PLACE = {  # attributes of an element that hold its place
    *("points", "xtl", "ytl", "xbr", "ybr", "rotation", "cx", "cy", "rx", "ry"),
    *("rle", "left", "top", "width", "height"),
}
MEMBERS = {"source": "file", "occluded": "0", "z_order": "0"}  # of every shape, as CVAT writes them
ELLIPSE_VERTICES = 64  # of an ellipse: its area is 0.2 % too small
BYTES_PER_BYTE = 12  # of memory, for each of the file, once parsed
NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
MAX_DEPTH = 32  # of elements in elements; CVAT's own files have 8


@dataclass(frozen=True, eq=False)
class Cvat:
    """The parsed file."""

    path: Path
    root: Element
    complete = False

    def read(self, photograph: Photograph) -> GivenRegions:
        """One region for each shape with an area: polygon, box, ellipse or mask."""
        image = self._image(photograph)
        notes = other_photograph(image.get("name"), photograph)
        name = f"image '{image.get('name', '')[:80]}' of {self.path}"
        if image.get("width") is not None and image.get("height") is not None:
            check_size(name, (_whole(image, "width", name), _whole(image, "height", name)), photograph)
        found = []
        for row, (of, element) in enumerate(self._shapes):
            if of is not image or element.tag not in AREAS:
                continue
            body = _body(element, f"shape {row} ({element.tag}) of {name}", photograph)
            properties: dict[str, object] = {k: v for k, v in element.attrib.items() if k not in PLACE | {"label"}}
            properties |= {each.get("name", ""): each.text or "" for each in element.iter("attribute")}
            label = element.get("label")
            found.append(GivenRegion(body, None, None, 1.0, label and plain(label), plain(properties), row))
        if lines := sum(element.tag in OTHERS for element in image):
            notes.append(f"{counted(lines, 'shape')} without an area (points, lines, tags, ...) left out")
        return GivenRegions(found, notes)

    def names(self, stem: str) -> tuple[str, ...]:
        """One file."""
        return (f"{stem}.xml",)

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """The same shapes, of one image: masks as masks, all others as polygons. Several pieces and holes are joined
        into one ring (`one_ring`), as CVAT's polygons have neither."""
        given = self._shapes[carried[0].region.row][0] if carried else self.root.findall("image")[0]
        size = {"width": str(photograph.width), "height": str(photograph.height)}
        image = Element("image", {**given.attrib, "name": name_of(photograph), **size})
        for each, shape in placed(carried):
            old = self._shapes[each.region.row][1]
            kept = {key: value for key, value in old.attrib.items() if key not in PLACE}
            tag, place = _outline(each.region, shape, photograph)
            new = ElementTree.SubElement(image, tag, {**kept, **place})
            new.extend(deepcopy(child) for child in old if not child.get("name", "").startswith(PREFIX))
            for name, value in ours(each.attributes).items():
                ElementTree.SubElement(new, "attribute", name=name).text = _text(value)
        root = Element(self.root.tag, self.root.attrib)
        root.extend(deepcopy(child) for child in self.root if child.tag != "image")
        root.append(image)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode")
        atomic_write(path, f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n')
        return []

    def _image(self, photograph: Photograph) -> Element:
        images = self.root.findall("image")
        return images[of_photograph([each.get("name") for each in images], photograph, self.path)]

    @cached_property
    def _shapes(self) -> list[tuple[Element, Element]]:
        """All shapes of the file, each with its image."""
        return [(image, element) for image in self.root.findall("image") for element in image]


def open_cvat(path: Path) -> Cvat:
    """A file of CVAT for images. `InputError` for other XML, for CVAT for video, and for files with a document type or
    entities, which could make a parser read other files or grow without end."""
    try:
        memory.refuse_above(path.stat().st_size * BYTES_PER_BYTE, f"region file {path}", "give a part of its images")
        text = read_text(path)  # as UTF-8, whatever it declares
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise InputError(f"{path} has a document type or entities, which CVAT does not write: export it anew")
        root = ElementTree.fromstring(text)
        if _depth(root) > MAX_DEPTH:
            raise ValueError("it is nested too deeply")
    except OSError as error:
        raise InputError(f"cannot read region file {path}: {error.strerror}") from error
    except (ValueError, ElementTree.ParseError) as error:
        raise InputError(f"region file {path} is not valid XML in UTF-8: write it anew") from error
    if root.tag == "annotations" and root.find("track") is not None:
        raise InputError(f"{path} is of CVAT for video: export it as 'CVAT for images 1.1'")
    if root.tag != "annotations" or root.find("image") is None:
        raise InputError(f"{path} is XML, but not of CVAT for images 1.1: export the annotations in that format")
    return Cvat(path, root)


def begin(regions: Sequence[GivenRegion], labels: Sequence[str]) -> Cvat:
    """A document of its own (`region.Begin`)."""
    root = Element("annotations")
    ElementTree.SubElement(root, "version").text = "1.1"
    task = ElementTree.SubElement(ElementTree.SubElement(root, "meta"), "task")
    known = ElementTree.SubElement(task, "labels")
    for label in labels:
        ElementTree.SubElement(ElementTree.SubElement(known, "label"), "name").text = _text(label)
    image = ElementTree.SubElement(root, "image", id="0")
    for region in regions:
        own = {key: _text(region.properties.get(key, value)) for key, value in MEMBERS.items()}
        shape = ElementTree.SubElement(image, "polygon", {"label": _text(region.label), **own})
        for name, value in region.properties.items():
            if name not in MEMBERS:
                ElementTree.SubElement(shape, "attribute", name=_text(name)).text = _text(value)
    return Cvat(Path(), root)


def _depth(root: Element) -> int:
    """How many elements lie in each other; more than `MAX_DEPTH` are not counted."""
    level, depth = [root], 0
    while level and depth <= MAX_DEPTH:
        level, depth = [child for element in level for child in element], depth + 1
    return depth


def _body(element: Element, name: str, photograph: Photograph) -> Mask | tuple[geojson.Rings, ...]:
    if element.tag == "polygon":
        pairs = [pair.split(",") for pair in element.get("points", "").split(";")]
        return ([geojson.ring([[_parsed(v, name) for v in pair] for pair in pairs], name)],)
    if element.tag == "mask":
        return _mask(element, name, photograph)
    angle = math.radians(_number(element, "rotation", name)) if element.get("rotation") else 0.0
    if element.tag == "box":
        x0, y0, x1, y1 = (_number(element, key, name) for key in ("xtl", "ytl", "xbr", "ybr"))
        center = np.array([x0 + x1, y0 + y1]) / 2
        around = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) - center
    else:
        x, y, a, b = (_number(element, key, name) for key in ("cx", "cy", "rx", "ry"))
        turns = 2 * np.pi * np.arange(ELLIPSE_VERTICES) / ELLIPSE_VERTICES
        center, around = np.array([x, y]), np.column_stack([a * np.cos(turns), b * np.sin(turns)])
    if angle:  # clockwise as one looks at it, from x to y
        around = around @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    return ([geojson.ring((center + around).tolist(), name)],)


def _mask(element: Element, name: str, photograph: Photograph) -> Mask:
    """A mask whose run lengths go along the rows of its crop, background first."""
    x0, y0, width, height = (_whole(element, key, name) for key in ("left", "top", "width", "height"))
    if not (0 <= x0 <= photograph.width - width and 0 <= y0 <= photograph.height - height and min(width, height) >= 0):
        raise InputError(f"{name} reaches out of the image: correct the file")
    try:
        runs = [int(run) for run in element.get("rle", "").split(",")]
        return cropped(Mask(x0, y0, run_lengths.pixels(runs, height, width).T))
    except ValueError as error:
        raise InputError(f"{name} has run lengths that are not those of its crop: write it anew") from error


def _outline(region: GivenRegion, shape: Shape, photograph: Photograph) -> tuple[str, dict[str, str]]:
    """The tag and the attributes that hold a place."""
    if not isinstance(region.body, Mask):
        return "polygon", {"points": ";".join(f"{x!r},{y!r}" for x, y in one_ring(shape).tolist())}
    mask = pixels_of(shape, photograph)
    rows, columns = mask.bits.shape
    turned = Mask(0, 0, mask.bits.T)  # as run lengths go down columns
    runs = ", ".join(map(str, run_lengths.run_lengths(turned, rows, columns).tolist()))
    place = {"left": mask.x0, "top": mask.y0, "width": columns, "height": rows}
    return "mask", {"rle": runs, **{key: str(value) for key, value in place.items()}}


def _text(value: object) -> str:
    """A value as CVAT writes it, without the characters that XML cannot hold."""
    if isinstance(value, bool | list | dict):
        value = json.dumps(value, ensure_ascii=False)
    return "" if value is None else NO_XML.sub("?", str(value))


def _whole(element: Element, key: str, name: str) -> int:
    return int(_number(element, key, name))


def _number(element: Element, key: str, name: str) -> float:
    return _parsed(element.get(key, ""), f"{name}, {key},")


def _parsed(text: str, name: str) -> float:
    try:
        number = float(text)
    except ValueError as error:
        raise InputError(f"{name} has '{text[:40]}' where a number must be: correct the file") from error
    if not abs(number) < geojson.MAX_COORDINATE:
        raise InputError(f"{name} has a coordinate that is not a finite number of pixels: correct the file")
    return number
