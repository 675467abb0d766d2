"""Regions that people bring along: a label image, COCO or SAM annotations, or GeoJSON."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
import PIL.Image
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from zpm2.config import SegmentConfig, VectorizeConfig
from zpm2.detect.vectorize import from_shape, pieces, rasterize, vectorize, with_parents
from zpm2.errors import InputError
from zpm2.io import geojson
from zpm2.model import Image, Mask, Polygon

FORMATS = (
    "a label image (.png, .tif or .npy of whole numbers, 0 = background), COCO annotations or SAM's automatic masks "
    "(.json), or a GeoJSON FeatureCollection in pixel coordinates (.geojson, .json)"
)


@dataclass(frozen=True, eq=False)
class Region:
    """One region as its file has it: pixels, or the rings of its polygons, which nobody has checked yet."""

    body: Mask | tuple[geojson.Rings, ...]
    id: int | None
    score: float = 1.0
    label: str | None = None


@dataclass(frozen=True, eq=False)
class _Piece:
    """One connected piece of a region, valid and inside of the image."""

    body: Mask | shapely.Polygon
    rank: int  # 0 for the largest piece of its region
    region: Region


class PrecomputedSegmenter:
    """Regions from a file instead of from a network; both a `Segmenter` and a `PolygonSource`.

    The file is read at once, so that a wrong one is known before long work. Pixels become polygons as those of any
    segmenter do, with the tolerance of `config`; polygons keep their vertices as they stand in the file. A polygon's id
    is that of its region (label value, annotation id, feature id) where these are whole numbers and distinct; further
    pieces of a region are numbered on from the greatest. Pieces under `min_area` px^2 are dropped. `notes` says what
    the latest call dropped, cut or repaired.

    Raises `InputError` for a file that cannot be read, is of another image size, or holds no region of the image.
    """

    name = "precomputed"

    def __init__(
        self, path: str | Path, config: VectorizeConfig | None = None, min_area: float = SegmentConfig().min_area
    ) -> None:
        self.path = Path(path)
        self.config = config or VectorizeConfig()
        self.min_area = min_area
        self.notes: list[str] = []
        self._regions = open_regions(self.path)

    def segment(self, image: Image) -> list[Mask]:
        """The regions as pixels, one mask per connected piece; of polygons the pixels whose centre lies inside."""
        found = []
        for piece in self._pieces(image):
            mask = piece.body if isinstance(piece.body, Mask) else rasterize(piece.body)
            found.append(replace(mask, score=piece.region.score, label=piece.region.label))
        filled = [mask for mask in found if mask.bits.any()]
        if len(filled) < len(found):
            self.notes.append(f"{_regions(len(found) - len(filled))} without a pixel centre inside left out")
        return filled

    def polygons(self, image: Image) -> list[Polygon]:
        """The regions as polygons with parents, one per connected piece."""
        found = self._pieces(image)
        masks = [piece.body for piece in found if isinstance(piece.body, Mask)]
        traced = iter(vectorize(masks, self.config, self.min_area, (image.width, image.height)))
        polygons = [
            next(traced) if isinstance(piece.body, Mask) else from_shape(piece.body, 0, piece.region.score)
            for piece in found
        ]
        named = zip(polygons, self._ids(found), found, strict=True)
        return with_parents(
            [replace(p, id=id, score=piece.region.score, label=piece.region.label) for p, id, piece in named]
        )

    def _pieces(self, image: Image) -> list[_Piece]:
        self.notes.clear()
        regions = self._regions(image)
        if not regions:
            raise InputError(f"{self.path} holds no region: give a file with at least one")
        counts: Counter[str] = Counter()
        box = shapely.box(0, 0, image.width, image.height)
        found = []
        for region in regions:
            bodies = pieces(region.body) if isinstance(region.body, Mask) else _valid(region.body, box, counts)
            enough = [body for body in bodies if body.area >= self.min_area and body.area > 0]
            counts[f"under {self.min_area:g} px^2 left out"] += len(bodies) - len(enough)
            found += [_Piece(body, rank, region) for rank, body in enumerate(enough)]
        self.notes += [f"{_regions(n)} {what}" for what, n in counts.items() if n]
        if not found:
            raise InputError(
                f"{self.path} has no region of at least {self.min_area:g} px^2 in the {image.width} x {image.height} "
                "px image: check that its coordinates are pixels of this image, or lower segment.min_area"
            )
        return found

    def _ids(self, found: list[_Piece]) -> list[int]:
        given = [piece.region.id for piece in found if piece.rank == 0]
        usable = [id for id in given if id is not None and id < 2**53]  # what a JSON number holds exactly
        if len(set(usable)) < len(given):
            if any(id is not None for id in given):
                self.notes.append("the regions' ids are not distinct whole numbers: numbered from 0 instead")
            return list(range(len(found)))
        further = max(usable)
        ids = []
        for piece in found:
            further += piece.rank > 0
            ids.append(further if piece.rank or piece.region.id is None else piece.region.id)
        return ids


def open_regions(path: Path) -> Callable[[Image], list[Region]]:
    """Reads a file, whose kind is seen from its ending and content, as a function that gives an image's regions.

    `InputError` where the file is missing or damaged, and with the list of kinds where it is none of them. The function
    raises it where the regions are those of another image.
    """
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"region file {path} does not exist: give {FORMATS}")
    if suffix in (".png", ".tif", ".tiff", ".npy"):
        return partial(_from_labels, path, _read_labels(path))
    if suffix in (".json", ".geojson"):
        data = _read_json(path)
        if isinstance(data, dict) and data.get("type") == "FeatureCollection":
            return partial(_from_features, path, geojson.parse(data, str(path)))
        annotations = data.get("annotations") if isinstance(data, dict) else data
        if isinstance(annotations, list) and all(isinstance(a, dict) and "segmentation" in a for a in annotations):
            return partial(_from_annotations, path, data if isinstance(data, dict) else {"annotations": data})
    raise InputError(f"{path} holds no regions that can be read: give {FORMATS}")


def _read_labels(path: Path) -> NDArray[np.integer[Any]]:
    try:
        if path.suffix.lower() == ".npy":
            labels = np.load(path, allow_pickle=False)
        else:
            with PIL.Image.open(path) as picture:
                labels = np.asarray(picture)
    except (OSError, ValueError, EOFError, SyntaxError, PIL.Image.DecompressionBombError) as error:
        raise InputError(f"cannot read label image {path}: it is damaged or no {path.suffix} file") from error
    if labels.ndim != 2:
        raise InputError(
            f"label image {path} must have one band, its shape is {labels.shape}: give labels, not colours"
        )
    if labels.dtype.kind == "b":
        labels = labels.astype(np.uint8)
    if labels.dtype.kind not in "iu":
        raise InputError(f"label image {path} holds {labels.dtype}, not whole numbers: convert it to 8 or 16 bit")
    if (labels < 0).any():
        raise InputError(f"label image {path} has values below 0: set them to 0, the background")
    return np.asarray(labels)


def _from_labels(path: Path, labels: NDArray[np.integer[Any]], image: Image) -> list[Region]:
    _check_size(str(path), (labels.shape[1], labels.shape[0]), image)
    values, compact = np.unique(labels, return_inverse=True)
    compact = compact.reshape(labels.shape).astype(np.int32) + 1  # find_objects looks at labels from 1 on
    found = []
    for k, (value, (rows, columns)) in enumerate(zip(values, ndimage.find_objects(compact), strict=True), start=1):
        if value:
            mask = Mask(columns.start, rows.start, compact[rows, columns] == k)
            found.append(Region(mask, int(value), label=str(value)))
    return found


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"cannot read region file {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"region file {path} is not valid JSON: write it anew") from error


def _from_features(path: Path, collection: geojson.FeatureCollection, image: Image) -> list[Region]:
    if collection.size:
        _check_size(str(path), collection.size, image)
    return [Region(f.parts, f.id, f.score, f.label) for f in collection.features]


def _from_annotations(path: Path, data: dict[str, Any], image: Image) -> list[Region]:
    names = {
        str(c.get("id")): str(c.get("name")) for c in _objects(data.get("categories")) if c.get("name") is not None
    }
    found = []
    for k, annotation in enumerate(_annotations_of(path, data, image)):
        name = f"annotation {k} of {path}"
        score = annotation.get("score", annotation.get("predicted_iou"))
        found.append(
            Region(
                _segmentation(annotation["segmentation"], name, image),
                geojson.region_id(annotation.get("id")),
                geojson.score(score, name),
                names.get(str(annotation.get("category_id"))),
            )
        )
    return found


def _annotations_of(path: Path, data: dict[str, Any], image: Image) -> list[dict[str, Any]]:
    """Those of the image: all where the file is about one, else those of the entry with the image's file name."""
    annotations: list[dict[str, Any]] = data["annotations"]
    images = list(_objects(data.get("images") or [data.get("image")]))
    if len(images) > 1:
        name = PureWindowsPath(image.path or "").name
        images = [entry for entry in images if PureWindowsPath(str(entry.get("file_name"))).name == name]
        if len(images) != 1:
            raise InputError(
                f"{path} describes several images, {len(images)} of them by the file name '{name}': one must"
            )
        annotations = [a for a in annotations if a.get("image_id") == images[0].get("id")]
    elif not images and len({str(a.get("image_id")) for a in annotations}) > 1:
        raise InputError(f"{path} has annotations of several images but not the images' names: add its list of images")
    for entry in images:
        if isinstance(entry.get("width"), int) and isinstance(entry.get("height"), int):
            _check_size(str(path), (entry["width"], entry["height"]), image)
    return annotations


def _segmentation(segmentation: Any, name: str, image: Image) -> Mask | tuple[geojson.Rings, ...]:
    if isinstance(segmentation, dict):
        return _cropped(_decode(segmentation, name, image))
    if not isinstance(segmentation, list) or not all(isinstance(p, list) and len(p) % 2 == 0 for p in segmentation):
        raise InputError(
            f"{name} has a segmentation that is neither RLE nor lists of x, y, x, y, ...: correct the file"
        )
    return tuple([geojson.ring(list(zip(part[::2], part[1::2], strict=True)), name)] for part in segmentation)


def _decode(rle: dict[str, Any], name: str, image: Image) -> NDArray[np.bool_]:
    """(h, w) pixels of COCO's run lengths, which go down the columns and start with background."""
    size, counts = rle.get("size"), rle.get("counts")
    if not isinstance(size, list) or len(size) != 2 or not all(isinstance(v, int) for v in size):
        raise InputError(f"{name} has an RLE without its size [height, width]: correct the file")
    _check_size(name, (size[1], size[0]), image)
    if isinstance(counts, str):
        counts = _run_lengths(counts, name)
    runs = counts if isinstance(counts, list) and all(isinstance(n, int) and n >= 0 for n in counts) else []
    if sum(runs) != size[0] * size[1]:
        raise InputError(f"{name} has run lengths that do not add up to {size[1]} x {size[0]} px: write it anew")
    return np.asarray(np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(size[1], size[0]).T)


def _run_lengths(text: str, name: str) -> list[int]:
    """The numbers in a compressed RLE (COCO's maskApi.c, rleFrString, which takes damaged ones without a word).

    Each character holds five bits, lowest first, and whether the number goes on; from the fourth number on it is the
    difference to the last but one.
    """
    codes = np.array([ord(character) - 48 for character in text], np.int64)
    last = codes & 32 == 0
    starts = np.flatnonzero(np.r_[True, last[:-1]])[: len(codes)]
    place = np.arange(len(codes)) - np.repeat(starts, np.diff(np.r_[starts, len(codes)]))
    if not len(codes) or not last[-1] or (codes < 0).any() or (codes > 63).any() or place.max() > 6:
        raise InputError(f"{name} has a compressed RLE that is damaged: write it anew")
    numbers = np.add.reduceat((codes & 31) << (5 * place), starts)
    numbers -= np.where(codes[last] & 16, 1 << (5 * (place[last] + 1)), 0)
    numbers[1::2] = np.cumsum(numbers[1::2])
    numbers[2::2] = np.cumsum(numbers[2::2])
    return [int(n) for n in numbers]


def _cropped(bits: NDArray[np.bool_]) -> Mask:
    rows, columns = np.flatnonzero(bits.any(1)), np.flatnonzero(bits.any(0))
    if not len(rows):
        return Mask(0, 0, np.zeros((0, 0), bool))
    crop = bits[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return Mask(int(columns[0]), int(rows[0]), np.array(crop, order="C"))


def _valid(parts: tuple[geojson.Rings, ...], box: shapely.Polygon, counts: Counter[str]) -> list[shapely.Polygon]:
    """The polygons of a region, repaired and cut at the image's `box`, the largest first; `counts` says what was done.

    What is valid and inside keeps its vertices, but for repeated ones.
    """
    if not parts:
        counts["that are no polygons left out"] += 1
    found: list[shapely.Polygon] = []
    for rings in parts:
        if not rings or len(rings[0]) < 3:
            counts["with fewer than 3 vertices left out"] += 1
            continue
        shape = shapely.remove_repeated_points(shapely.Polygon(rings[0], [r for r in rings[1:] if len(r) > 2]))
        if not shape.is_valid:
            counts["with crossing rings repaired"] += 1
            shape = shapely.make_valid(shape)
            counts["without any area left out"] += shape.area == 0
        if not box.covers(shape):
            shape = shape.intersection(box)
            away = shape.area == 0
            counts["outside of the image left out" if away else "reaching out of the image cut at its border"] += 1
        found += _polygons_in(shape)
    return sorted(found, key=lambda shape: -shape.area)


def _polygons_in(shape: shapely.Geometry) -> Iterator[shapely.Polygon]:
    flat = shapely.get_parts(shapely.get_parts(shape))  # twice: a collection may hold a MultiPolygon
    return (part for part in flat if isinstance(part, shapely.Polygon) and not part.is_empty)


def _check_size(name: str, size: tuple[int, int], image: Image) -> None:
    if size != (image.width, image.height):
        raise InputError(
            f"{name} is made for {size[0]} x {size[1]} px, the image has {image.width} x {image.height} px: "
            "the two must be of one size"
        )


def _objects(values: Any) -> Iterator[dict[str, Any]]:
    return (value for value in values if isinstance(value, dict)) if isinstance(values, list) else iter(())


def _regions(n: int) -> str:
    return "1 region" if n == 1 else f"{n} regions"
