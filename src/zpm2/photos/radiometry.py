"""Pixel values of any type to 8-bit RGB, and which pixels hold data: one rule for all readers."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.config import StretchConfig
from zpm2.errors import InputError
from zpm2.model import Image
from zpm2.model.messages import Note
from zpm2.photos import checks

OPAQUE = Note("The alpha band was dropped; every pixel was opaque.")
NOT_TRANSPARENT = Note("The alpha band was dropped; no pixel was fully transparent.")

DEFAULTS = StretchConfig()

Values = NDArray[np.number | np.bool_]
Valid = NDArray[np.bool_] | None  # (h, w) where there is data; None: everywhere


def to_image(
    values: Values,
    what: str,
    path: str | None = None,
    notes: Sequence[str] = (),
    nodata: float | None = None,
    stretch: StretchConfig = DEFAULTS,
) -> Image:
    """(h, w), (h, w, 1), (h, w, 3) or (h, w, 4) values, the last with alpha, as a photograph. See `read_image`.

    Pixels that are transparent, masked in any band (`np.ma`), or `nodata` in all bands, hold no data. Values with a
    `path` come from a file: there NaN, infinity and a value that fills the border are no data either. `InputError` for
    values that cannot be used.
    """
    checks.check(values, what)
    notes = list(notes)
    valid: Valid = None
    if np.ma.is_masked(values):
        valid = np.asarray(~np.ma.getmaskarray(values).reshape(*values.shape[:2], -1).any(axis=2))
    values = np.ma.getdata(values)
    if values.dtype == np.bool_:
        values = values.astype(np.uint8) * 255
        notes.append(Note("1-bit values became black and white."))
    if values.ndim == 2:
        values = values[..., None]
    if values.shape[2] == 4:
        values, alpha = values[..., :3], values[..., 3]
        visible = np.asarray(alpha > 0)
        if visible.all():
            notes.append(OPAQUE if (alpha == alpha[0, 0]).all() else NOT_TRANSPARENT)
        valid = both(valid, visible)
    if nodata is not None:
        valid = both(valid, differs(values, nodata))
    if values.dtype.kind == "f":
        finite = np.asarray(np.isfinite(values).all(axis=2))
        if path is None and (bad := np.count_nonzero(~np.isfinite(values if valid is None else values[valid]))):
            raise InputError(f"{what} has {bad} NaN or infinite values: replace them before matching")
        valid = both(valid, finite)
    if valid is not None:
        notes += gap_notes(valid, what)
    if values.dtype != np.uint8:
        (low, high), fills, more = look(values, valid, path is not None, stretch)
        notes += more
        for fill in fills:
            valid = both(valid, differs(values, fill))
        values = scaled(values if valid is None else np.where(valid[..., None], values, low), low, high)
    rgb = np.empty((*values.shape[:2], 3), np.uint8)
    rgb[...] = values
    if valid is None or valid.all():
        return Image(rgb, path, tuple(notes))
    rgb[~valid] = 0
    return Image(rgb, path, tuple(notes), valid)


def bytes_each(values: NDArray[np.generic]) -> int:
    """Memory per pixel that `to_image` takes, in bytes: a copy of values that are not 8-bit, these as 8 bit, and the
    result."""
    bands = values.shape[2] if values.ndim == 3 else 1
    return 3 + (0 if values.dtype == np.uint8 else bands * (values.itemsize + 1))


def both(one: Valid, other: Valid) -> Valid:
    """The pixels that are valid in both masks."""
    if one is None or other is None:
        return other if one is None else one
    return one & other


def differs(values: Values, nodata: float | Values) -> NDArray[np.bool_]:
    """(h, w) where some band of (h, w, bands) is not `nodata`."""
    return np.asarray((values != nodata).any(axis=2))


def gap_notes(valid: NDArray[np.bool_], what: str) -> list[str]:
    """A note where some pixels hold no data. `InputError` where all do not."""
    share = 1 - np.count_nonzero(valid) / valid.size
    if share == 1:
        raise checks.no_data(what)
    if share == 0:
        return []
    return [Note(f"Pixels without data (nodata, alpha or not finite) are left out: {max(share, 0.001):.1%}.")]


def look(
    values: Values, valid: Valid, guess: bool, stretch: StretchConfig = DEFAULTS
) -> tuple[tuple[float, float], list[Values], list[str]]:
    """How to convert (h, w, bands) values that are not 8-bit: the values that become 0 and 255, fill values, and notes.

    Fill values (bands,) fill the border without being declared as no data; they are looked for where `guess`.
    """
    fills: list[Values] = []
    notes = []
    low, high, note = brightness_range(_known(values, valid), stretch)
    while guess and "stretched" in note and (found := _fill(values, valid, stretch)) is not None:
        fill, share = found
        fills.append(fill)
        valid = both(valid, differs(values, fill))
        notes.append(
            f"{share:.1%} of the pixels, along the border, have the value {_text(fill)}, which is not declared as no "
            "data: they are taken as no data."
        )
        low, high, note = brightness_range(_known(values, valid), stretch)
    if guess and "stretched" in note:
        notes += _extremes(_known(values, valid), stretch)
    return (low, high), fills, [*notes, note]


def _known(values: Values, valid: Valid) -> Values:
    return values if valid is None else values[valid][:, None]


def _fill(values: Values, valid: Valid, stretch: StretchConfig) -> tuple[Values, float] | None:
    """The most frequent (bands,) value of the border and its share of the pixels with data; None where it does not fill
    the border or much of the photograph."""
    rim: NDArray[np.bool_] = np.ones(values.shape[:2], bool)
    rim[1:-1, 1:-1] = False
    found = values[rim if valid is None else rim & valid]
    if len(found) == 0:
        return None
    each, count = np.unique(found, axis=0, return_counts=True)
    fill, most = each[count.argmax()], count.max() / np.count_nonzero(rim)
    share = 1 - float(differs(_known(values, valid), fill).mean())
    filled = share >= stretch.fill_share and most >= stretch.noticed_share
    return (fill, share) if (filled or most >= stretch.fill_border_share) and share < stretch.picture_share else None


def _extremes(known: Values, stretch: StretchConfig) -> list[str]:
    """A note where many pixels have a lowest or highest value far from all others: perhaps it means no data."""
    notes = []
    for extreme in (known.min(), known.max()):
        other = differs(known, extreme)
        share = 1 - float(other.mean())
        rest = known[other]
        if not stretch.noticed_share <= share < stretch.picture_share:
            continue
        low, high = float(rest.min()), float(rest.max())
        if max(low - float(extreme), float(extreme) - high) > stretch.far_share * (high - low):
            notes.append(
                f"{share:.1%} of the pixels have the value {extreme:g}, far from all others: if it means no data, "
                "declare it so (gdal_edit.py -a_nodata)."
            )
    return notes


def _text(fill: Values) -> str:
    same = fill[:1] if (fill == fill[0]).all() else fill
    return ", ".join(f"{value:g}" for value in same)


def brightness_range(values: Values, stretch: StretchConfig = DEFAULTS) -> tuple[float, float, str]:
    """The values that become 0 and 255, and the note that says so. See `read_image` for the rule.

    values: (h, w) or (h, w, bands), floats (finite) or integers.
    """
    floating = values.dtype.kind == "f"
    kind = f"{values.dtype.itemsize * 8}-bit {'floats' if floating else 'integers'}"
    percentiles = stretch.low_percentile, stretch.high_percentile
    step = max(1, math.isqrt(values.shape[0] * values.shape[1] // stretch.sample_px))
    low, high = (float(v) for v in np.percentile(values[::step, ::step].astype(np.float64), percentiles))
    least, most = float(values.min()), float(values.max())
    for full in (1.0, 255.0) if floating else (255.0,):
        if least >= 0 and most <= full and high >= stretch.min_range * full:
            return 0.0, full, Note(f"The {kind} were read as brightness from 0 to {full:g}.")
    if high <= low:
        low, high = least, most
    return low, high, Note(f"The {kind} were stretched to 8 bit from the range {low:g} to {high:g}.")


def scaled(values: Values, low: float, high: float) -> NDArray[np.uint8]:
    """Finite values of any shape as 8 bit: `low` becomes 0 and `high` 255; values beyond are clipped."""
    scale = 255 / (high - low) if high > low else 0.0
    out = np.empty(values.shape, np.uint8)
    for row in range(0, len(values), 256):
        out[row : row + 256] = np.rint(np.clip((values[row : row + 256].astype(np.float64) - low) * scale, 0, 255))
    return out
