"""A result's folder: its files are written in an order that shows whether it is complete, and read back."""

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.photo_paths import find_photo, photo_reference
from zpm2.files.reading import WRONG, read_json
from zpm2.files.record import make_folder, remove_own
from zpm2.files.writing import atomic_write, claim, replaced_together
from zpm2.formats import registry
from zpm2.formats.convert import Members
from zpm2.formats.registry import OutputFormat, PairResult
from zpm2.model import SIDES
from zpm2.photos.pictures import png

DOCUMENT = "matches.json"
PICTURES = ("overlay.png", "unmatched.png", "contact.png")
REPORT = "report.html"
TILES = "report_files"  # the folder of what a report of large photographs loads
Files = Iterable[tuple[str, str | bytes]]  # name in the folder, content


def file_names(formats: Sequence[str] = ()) -> list[str]:
    """The names of all files that `save` may write."""
    written = [each for each in registry.known() if each.by_default is not None]
    written += [each for each in map(registry.FORMATS.get, formats) if each not in written]
    return _names(written)


def _names(written: Iterable[OutputFormat]) -> list[str]:
    return [*(name for each in written for name in each.files), *PICTURES, REPORT, TILES, DOCUMENT]


def save(
    result: PairResult,
    directory: str | Path,
    formats: Sequence[str],
    pictures: Mapping[str, NDArray[np.uint8]],
    report: Callable[[Members], Files] | None = None,
) -> Path:
    """Writes a result and `pictures` ((h, w, 3) RGB, by file name) into a folder; returns it.

    report: makes the page and its files from the document; None for no page. `MatchResult.save` describes the files.
    They take the place of all that an earlier result has there (`replaced_together`): where the document exists, the
    folder is complete.
    """
    asked = registry.chosen(formats)
    photographs = [side.path for side in (result.left, result.right) if side.path is not None]
    folder = claim(directory, file_names(formats), photographs)
    usual = [each for each in registry.known() if each.by_default is not None and each.by_default(result)]
    with replaced_together(folder, _names([*registry.known(), *asked])) as made:
        for each in [*usual, *(each for each in asked if each not in usual)]:
            each.write(result, made)
        for name, pixels in pictures.items():
            atomic_write(made / name, png(pixels))
        document = result.to_dict()
        for side in SIDES:
            document[side] |= photo_reference(document[side]["path"], made)
        write_report(made, report(document) if report else ())
        atomic_write(made / DOCUMENT, json.dumps(document, allow_nan=False))
    return folder


def write_report(folder: Path, files: Files) -> None:
    """Writes the page of a result and the files that it loads, and removes those of an earlier result."""
    written = set[Path]()
    for name, content in files:
        if name.startswith(f"{TILES}/") and not written:
            make_folder(folder / TILES)
        written.add(atomic_write(folder / name, content))
    for path in sorted({folder / REPORT, *(folder / TILES).glob("*.jpg")} - written):
        remove_own(path)
    if (folder / TILES).is_dir() and not any((folder / TILES).iterdir()):
        (folder / TILES).rmdir()


def read_document(path: str | Path, schema: str) -> tuple[Path, Members]:
    """The document of a folder (or the document itself): its path, and its content with the photographs' paths as they
    are now. `InputError` for a file that cannot be read or has another schema."""
    path = Path(path)
    file = path / DOCUMENT if os.path.isdir(path) else path
    try:
        document = read_json(file)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}; give the folder that zpm2 match wrote") from error
    except ValueError as error:
        raise InputError(f"{file} is not JSON: {error}; run zpm2 match again") from error
    if not isinstance(document, dict) or document.get("schema") != schema:
        raise InputError(f"{file} is not a {schema} file; give the folder that zpm2 match wrote")
    try:
        for side in SIDES:
            document[side]["path"] = find_photo(document[side], file.parent)
    except WRONG as error:
        raise incomplete(file, error) from error
    return file, document


def incomplete(file: Path, error: Exception) -> InputError:
    """The error for a document in which something is missing or of a wrong type."""
    return InputError(f"{file} is not complete ({error!r}); run zpm2 match again")
