"""COCO's annotations, and SAM's automatic masks, which are much the same."""

from collections.abc import Iterator
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.formats import coco, geojson, run_lengths
from zpm2.formats.convert import Members
from zpm2.formats.properties import plain, unprefixed
from zpm2.formats.regions.region import GivenRegion, GivenRegions, RegionReader, check_size, counted, other_photograph
from zpm2.model import Image, Mask

# members of an annotation that a polygon has under other names, or that follow from its outline
TAKEN = {"id", "image_id", "category_id", "segmentation", "bbox", "area"}


def open_annotations(path: Path, data: Members) -> RegionReader:
    """The regions of a parsed file with the list "annotations", whose entries are objects.

    `InputError` where none of them has a segmentation. Those without one are left out and counted.
    """
    annotations: list[Members] = data["annotations"]
    if annotations and all(a.get("segmentation") is None for a in annotations):
        raise InputError(f"{path} has annotations without a segmentation: boxes and key points are no regions")
    info = data.get("info")
    ours = isinstance(info, dict) and info.get("contributor") == coco.CONTRIBUTOR
    names = {str(c.get("id")): str(c.get("name")) for c in objects(data.get("categories")) if c.get("name") is not None}

    def read(image: Image) -> GivenRegions:
        entry = _entry(path, data, image)
        notes = other_photograph(entry.get("file_name"), image)
        if isinstance(entry.get("width"), int) and isinstance(entry.get("height"), int):
            check_size(str(path), (entry["width"], entry["height"]), image)
        of_image, strays = _of_image(data, entry)
        found = []
        for k in of_image:
            annotation, name = annotations[k], f"annotation {k} of {path}"
            if annotation.get("segmentation") is not None:
                body = _segmentation(annotation["segmentation"], name, image)
                found.append(_our_region(body, annotation, name) if ours else _region(body, annotation, names, name))
        for n, what in (
            (strays, "of no image that the file lists"),
            (len(of_image) - len(found), "without a segmentation"),
        ):
            if n:
                notes.append(f"{counted(n, 'annotation')} {what} left out")
        return GivenRegions(found, notes)

    return read


def objects(values: object) -> Iterator[Members]:
    """The objects of a list; none of anything else."""
    return (value for value in values if isinstance(value, dict)) if isinstance(values, list) else iter(())


def _region(
    body: Mask | tuple[geojson.Rings, ...], annotation: Members, names: dict[str, str], name: str
) -> GivenRegion:
    scored = "score" if annotation.get("score") is not None else "predicted_iou"
    return GivenRegion(
        body,
        geojson.region_id(annotation.get("id")),
        geojson.id_text(annotation.get("id")),
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


def _entry(path: Path, data: Members, image: Image) -> Members:
    """What the file says of the image: the only entry that it has (an empty one without any), else the one with the
    image's file name."""
    images = list(objects(data.get("images") or [data.get("image")]))
    if len(images) > 1:
        name = PureWindowsPath(image.path or "").name
        images = [entry for entry in images if PureWindowsPath(str(entry.get("file_name"))).name == name]
        if len(images) != 1:
            raise InputError(
                f"{path} describes several images, {len(images)} of them by the file name '{name}': one must"
            )
    elif not any("id" in entry for entry in images) and len({str(a.get("image_id")) for a in data["annotations"]}) > 1:
        raise InputError(f"{path} has annotations of several images but not the images' names: add its list of images")
    return images[0] if images else {}


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


def _segmentation(segmentation: object, name: str, image: Image) -> Mask | tuple[geojson.Rings, ...]:
    if isinstance(segmentation, dict):
        return _cropped(decode(segmentation, name, image))
    if not isinstance(segmentation, list) or not all(isinstance(p, list) and len(p) % 2 == 0 for p in segmentation):
        raise InputError(
            f"{name} has a segmentation that is neither RLE nor lists of x, y, x, y, ...: correct the file"
        )
    return tuple([geojson.ring(list(zip(part[::2], part[1::2], strict=True)), name)] for part in segmentation)


def decode(rle: Members, name: str, image: Image) -> NDArray[np.bool_]:
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


def _cropped(bits: NDArray[np.bool_]) -> Mask:
    rows, columns = np.flatnonzero(bits.any(1)), np.flatnonzero(bits.any(0))
    if not len(rows):
        return Mask(0, 0, np.zeros((0, 0), bool))
    crop = bits[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return Mask(int(columns[0]), int(rows[0]), np.array(crop, order="C"))
