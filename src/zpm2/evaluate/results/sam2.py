"""`sam2`: masks of a video of two frames, as SAM 2's tools/vos_inference.py writes them, and as DAVIS has them.

Either one picture a frame whose pixels are object numbers, NAME/00000.png and NAME/00001.png, or with
`--per_obj_png_file` a folder for each object, NAME/001/00000.png, whose masks may overlap.
"""

from pathlib import Path

from zpm2.errors import InputError
from zpm2.evaluate.results.areas import AreaMatches, Pieces, SizedPair, of_pixels
from zpm2.evaluate.results.files import pixels_of_labels, tracked
from zpm2.evaluate.results.registry import result_format
from zpm2.formats.regions.region import GivenRegion
from zpm2.model import Image, Mask


@result_format("sam2", where="NAME/*.png, two frames, or NAME/OBJECT/*.png")
def read(folder: Path, pair: SizedPair) -> AreaMatches | None:
    """FOLDER/NAME/ with the left frame first by name."""
    home = folder / pair.name
    if not home.is_dir():
        return None
    objects = {_number(path): path for path in sorted(home.iterdir()) if path.is_dir()}
    frames = sorted({path.name for place in (objects.values() or [home]) for path in place.glob("*.png")})
    if len(frames) != 2:
        raise InputError(f"{home} has {len(frames)} frames of PNG masks, not two: the left and the right one")
    found = []
    for frame, image in zip(frames, pair.images, strict=True):
        if objects:
            seen = {k: place / frame for k, place in objects.items() if (place / frame).exists()}
            each = {k: _whole(file, image) for k, file in seen.items()}
            found.append({k: (pieces, 1.0) for k, pieces in each.items() if pieces})
        else:
            regions = pixels_of_labels(home / frame, image)
            found.append({int(r.source_id or 0): (_pieces(r, home / frame), 1.0) for r in regions})
    return tracked((found[0], found[1]))


def _number(place: Path) -> int:
    if not place.name.isdecimal():
        raise InputError(f"{place} is no folder of an object: its name must be a number")
    return int(place.name)


def _whole(file: Path, image: Image) -> Pieces:
    """The area of all pixels that are not 0; none where the object is not seen."""
    return [piece for region in pixels_of_labels(file, image) for piece in _pieces(region, file)]


def _pieces(region: GivenRegion, file: Path) -> Pieces:
    mask = region.body
    assert isinstance(mask, Mask)  # of a label image
    return of_pixels(mask.bits, str(file), (mask.x0, mask.y0))
