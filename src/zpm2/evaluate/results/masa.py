"""`masa`: tracks of a video of two frames, as MASA writes them.

Either what demo/inference_with_json.py writes, a list with an object for each frame (`bboxes` as x0, y0, x1, y1,
`scores`, `instances_id`, `masks` with `--sam_mask`), or what its evaluation writes (tao_track.json), a list of boxes
(`image_id`, `track_id`, `bbox` as x, y, width, height, `score`), of which the smaller image number is the left frame.
"""

from pathlib import Path

import numpy as np

from zpm2.errors import InputError
from zpm2.evaluate.results.areas import AreaMatches, Pieces, SizedPair, numbers, of_box, of_pixels
from zpm2.evaluate.results.files import json_of, tracked
from zpm2.evaluate.results.registry import result_format
from zpm2.formats.convert import Members
from zpm2.model import Image

Frame = dict[int, tuple[Pieces, float]]


@result_format("masa", where="NAME.json")
def read(folder: Path, pair: SizedPair) -> AreaMatches | None:
    """FOLDER/NAME.json."""
    file = folder / f"{pair.name}.json"
    if not file.exists():
        return None
    document = json_of(file)
    if not isinstance(document, list) or not all(isinstance(entry, dict) for entry in document):
        raise InputError(f"{file} is no list of frames or of boxes, as MASA writes them")
    if document and "track_id" in document[0]:
        return tracked(_boxes(document, file))
    if len(document) != 2:
        raise InputError(f"{file} has {len(document)} frames, not two: the left and the right one")
    left, right = (_frame(*each, file) for each in zip(document, pair.images, strict=True))
    return tracked((left, right))


def _frame(frame: Members, image: Image, file: Path) -> Frame:
    ids = numbers(frame.get("instances_id"), (-1,), f'{file}: "instances_id" are no numbers')
    n = len(ids)
    boxes = numbers(
        frame.get("bboxes"), (n, 4) if n else (-1,), f'{file}: "bboxes" are not {n} boxes of x0, y0, x1, y1'
    )
    scores = numbers(frame.get("scores"), (n,), f'{file}: "scores" are not {n} numbers')
    masks = frame.get("masks") or [None] * n
    if not isinstance(masks, list) or len(masks) != n:
        raise InputError(f'{file}: "masks" are not {n}')
    found: Frame = {}
    for id, box, score, mask in zip(ids.astype(int).tolist(), boxes.tolist(), scores.tolist(), masks, strict=True):
        what = f"{file}: object {id}"
        if mask is None:
            found[id] = of_box(box, what), score
            continue
        size = (image.height, image.width)
        bits = numbers(mask, size, f"{what}: its mask is not {image.width} x {image.height} px") > 0
        if bits.any():
            found[id] = of_pixels(np.asarray(bits), what), score
    return found


def _boxes(entries: list[Members], file: Path) -> tuple[Frame, Frame]:
    frames: dict[int, Frame] = {}
    for k, entry in enumerate(entries):
        what = f"{file}: box {k}"
        image, track, score = (
            float(numbers(entry.get(name), (), f'{what}: "{name}" is no number'))
            for name in ("image_id", "track_id", "score")
        )
        x, y, width, height = numbers(entry.get("bbox"), (4,), f'{what}: "bbox" is not x, y, width, height')
        frames.setdefault(int(image), {})[int(track)] = of_box([x, y, x + width, y + height], what), score
    if len(frames) > 2:
        raise InputError(f"{file} has boxes of {len(frames)} images, not of two: write one file for each pair")
    if len(frames) < 2:
        raise InputError(f"{file} has boxes of one image only: which of the two it is cannot be told")
    left, right = sorted(frames)
    return frames[left], frames[right]
