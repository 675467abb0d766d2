"""COCO's annotations, and SAM's automatic masks, which are much the same."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.writing import atomic_write
from zpm2.formats import coco, geojson, run_lengths
from zpm2.formats.convert import Members
from zpm2.formats.properties import plain, unprefixed
from zpm2.formats.regions.outlines import cropped, parts_of, pixels_of, rings_of
from zpm2.formats.regions.region import (
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
    without_ours,
)
from zpm2.model import Mask

# members of an annotation that a polygon has under other names, or that follow from its outline
TAKEN = {"id", "image_id", "category_id", "segmentation", "bbox", "area"}
PLACES = {"keypoints", "num_keypoints", "point_coords", "crop_box"}  # members that hold other places in the photograph


@dataclass(frozen=True, eq=False)
class Annotations:
    """The parsed file, with the list "annotations", whose entries are objects."""

    path: Path
    data: Members
    bare: bool  # whether the file is the list of annotations alone
    complete = False

    def read(self, photograph: Photograph) -> GivenRegions:
        """The regions. Annotations without a segmentation are left out and counted."""
        path, data = self.path, self.data
        info = data.get("info")
        ours = isinstance(info, dict) and info.get("contributor") == coco.CONTRIBUTOR
        categories = objects(data.get("categories"))
        names = {str(c.get("id")): str(c.get("name")) for c in categories if c.get("name") is not None}
        entry = self._entry(photograph)
        notes = other_photograph(entry.get("file_name"), photograph)
        if isinstance(entry.get("width"), int) and isinstance(entry.get("height"), int):
            check_size(str(path), (entry["width"], entry["height"]), photograph)
        of_image, strays = _of_image(data, entry)
        found = []
        for k in of_image:
            annotation, name = data["annotations"][k], f"annotation {k} of {path}"
            if annotation.get("segmentation") is not None:
                body = _segmentation(annotation["segmentation"], name, photograph)
                if ours and "polygon_id" in annotation:
                    region = _our_region(body, annotation, name)
                else:
                    number = annotation.get("track_id" if ours and "track_id" in annotation else "id")
                    region = _region(body, annotation, number, names, name)
                found.append(replace(region, row=k))
        for n, what in (
            (strays, "of no image that the file lists"),
            (len(of_image) - len(found), "without a segmentation"),
        ):
            if n:
                notes.append(f"{counted(n, 'annotation')} {what} left out")
        return GivenRegions(found, notes)

    def names(self, stem: str) -> tuple[str, ...]:
        """One file."""
        return (f"{stem}.json",)

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """The same annotations, and the photograph as the only image.

        Pixels are written as pixels (compressed where they were), polygons as polygons, or as pixels where there are
        holes. Members that hold other places in the old photograph (`PLACES`) are left out.
        """
        rows = [self.data["annotations"][each.region.row] for each in carried]
        image = {"file_name": name_of(photograph), "width": photograph.width, "height": photograph.height}
        own = {str(row.get("image_id")): row.get("image_id") for row in rows if row.get("image_id") is not None}
        written = []
        for each, shape in placed(carried):
            row = self.data["annotations"][each.region.row]
            members = {key: value for key, value in without_ours(row).items() if key not in PLACES}
            written.append(members | _outline(each.region, row, shape, photograph) | ours(each.attributes))
        document: Members = self.data | {"annotations": written}
        if isinstance(self.data.get("image"), dict):
            document["image"] = self.data["image"] | image
        else:
            images = list(objects(self.data.get("images")))
            chosen = images if len(images) == 1 else [e for e in images if str(e.get("id")) in own]
            document["images"] = [{"id": next(iter(own.values()), 1)} | (chosen or [{}])[0] | image]
        atomic_write(path, json.dumps(plain(written if self.bare else document), ensure_ascii=False))
        return []

    def _entry(self, photograph: Photograph) -> Members:
        """What the file says of the image: the only entry that it has (an empty one without any), else the one with the
        image's file name."""
        images = list(objects(self.data.get("images") or [self.data.get("image")]))
        if len(images) > 1:
            return images[of_photograph([entry.get("file_name") for entry in images], photograph, self.path)]
        several = len({str(a.get("image_id")) for a in self.data["annotations"]}) > 1
        if not any("id" in entry for entry in images) and several:
            raise InputError(
                f"{self.path} has annotations of several images but not the images' names: add its list of images"
            )
        return images[0] if images else {}


def open_annotations(path: Path, annotations: list[Members], data: Members | None = None) -> Annotations:
    """The annotations of a parsed file: of an object with the list "annotations", or (None) of such a list alone.

    `InputError` where none of them has a segmentation.
    """
    if annotations and all(a.get("segmentation") is None for a in annotations):
        raise InputError(f"{path} has annotations without a segmentation: boxes and key points are no regions")
    return Annotations(path, {"annotations": annotations} if data is None else data, data is None)


def objects(values: object) -> Iterator[Members]:
    """The objects of a list; none of anything else."""
    return (value for value in values if isinstance(value, dict)) if isinstance(values, list) else iter(())


def _region(
    body: Mask | tuple[geojson.Rings, ...], annotation: Members, number: object, names: dict[str, str], name: str
) -> GivenRegion:
    scored = "score" if annotation.get("score") is not None else "predicted_iou"
    return GivenRegion(
        body,
        geojson.region_id(number),
        geojson.id_text(number),
        geojson.score(annotation.get(scored), name),
        names.get(str(annotation.get("category_id"))),
        plain({key: value for key, value in annotation.items() if key not in TAKEN | {scored}}),
    )


def _our_region(body: Mask | tuple[geojson.Rings, ...], annotation: Members, name: str) -> GivenRegion:
    """One of a file that `zpm2 match` wrote: with the polygon's own id, and with what it was given with."""
    number = annotation.get("polygon_id")
    source_id, label = annotation.get("source_id"), annotation.get("label")
    return GivenRegion(
        body,
        geojson.region_id(number),
        geojson.id_text(number if source_id is None else source_id),
        geojson.score(annotation.get("score"), name),
        None if label is None else str(label),
        plain(unprefixed(annotation, coco.OURS)),
    )


def _of_image(data: Members, entry: Members) -> tuple[list[int], int]:
    """The rows of the annotations of the image of that entry, and how many are of no image that the file lists."""
    listed = {str(other["id"]) for other in objects(data.get("images")) if other.get("id") is not None}
    images = [annotation.get("image_id") for annotation in data["annotations"]]
    if not listed:
        return list(range(len(images))), 0
    alone = str(entry.get("id")) if len(listed) == 1 else None  # what does not say of which image it is, is of this one
    names = [alone if image is None else str(image) for image in images]
    rows = [k for k, name in enumerate(names) if name == str(entry.get("id"))]
    return rows, sum(name not in listed for name in names)


def _segmentation(segmentation: object, name: str, image: Photograph) -> Mask | tuple[geojson.Rings, ...]:
    if isinstance(segmentation, dict):
        return cropped(Mask(0, 0, decode(segmentation, name, image)))
    if not isinstance(segmentation, list) or not all(isinstance(p, list) and len(p) % 2 == 0 for p in segmentation):
        raise InputError(
            f"{name} has a segmentation that is neither RLE nor lists of x, y, x, y, ...: correct the file"
        )
    return tuple([geojson.ring(list(zip(part[::2], part[1::2], strict=True)), name)] for part in segmentation)


def decode(rle: Members, name: str, image: Photograph) -> NDArray[np.bool_]:
    """(h, w) pixels of COCO's run lengths, `InputError` for those of another image and for damaged ones."""
    size, counts = rle.get("size"), rle.get("counts")
    if not isinstance(size, list) or len(size) != 2 or not all(isinstance(v, int) for v in size):
        raise InputError(f"{name} has an RLE without its size [height, width]: correct the file")
    check_size(name, (size[1], size[0]), image)
    try:
        runs = run_lengths.decompressed(counts) if isinstance(counts, str) else counts
        if not isinstance(runs, list) or not all(isinstance(n, int) for n in runs):
            runs = []  # which add up to no image
        return run_lengths.pixels(runs, size[1], size[0])
    except ValueError as error:
        raise InputError(f"{name} {error}: write it anew") from error


def _outline(region: GivenRegion, row: Members, shape: Shape, photograph: Photograph) -> Members:
    """The members of an annotation that follow from its outline."""
    size = photograph.width, photograph.height
    if not isinstance(region.body, Mask) and not any(part.interiors for part in parts_of(shape)):
        x0, y0, x1, y1 = shape.bounds
        rings = [rings_of(part)[0][:-1].ravel().tolist() for part in parts_of(shape)]
        return {"bbox": [x0, y0, x1 - x0, y1 - y0], "area": shape.area, "segmentation": rings}
    members = coco.pixels(pixels_of(shape, photograph), *size)
    given = row.get("segmentation")
    if isinstance(given, dict) and isinstance(given.get("counts"), list):
        runs = run_lengths.decompressed(members["segmentation"]["counts"])
        members["segmentation"] = {"size": [photograph.height, photograph.width], "counts": runs}
    return members
