"""What the readers share: files that are read whole, and objects that both frames of a pair show."""

from collections.abc import Mapping
from pathlib import Path

from zpm2.errors import InputError
from zpm2.evaluate.results.areas import AreaMatches, Pieces
from zpm2.files.reading import read_json
from zpm2.formats.regions.labels import open_labels
from zpm2.formats.regions.region import GivenRegion
from zpm2.model import Image


def json_of(file: Path) -> object:
    """The value in a JSON file; `InputError` where it cannot be read."""
    try:
        return read_json(file)
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read: {error}") from error


def pixels_of_labels(file: Path, image: Image) -> list[GivenRegion]:
    """The regions of a label image of the size of `image`, by their numbers; each `body` is a mask."""
    return open_labels(file).read(image).regions


def tracked(frames: tuple[Mapping[int, tuple[Pieces, float]], Mapping[int, tuple[Pieces, float]]]) -> AreaMatches:
    """Objects by their numbers in the left and in the right frame, each with its score: the same number is a match,
    with the smaller of both scores; the others have none."""
    left, right = frames
    both = sorted(left.keys() & right.keys())
    matches = [(left[k][0], right[k][0], min(left[k][1], right[k][1])) for k in both]
    others = [[side[k][0] for k in sorted(side.keys() - set(both))] for side in frames]
    return AreaMatches(matches, (others[0], others[1]))
