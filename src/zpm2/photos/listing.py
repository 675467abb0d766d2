"""Photographs in folders, and their sizes."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from zpm2.errors import InputError
from zpm2.files.listing import existing, natural
from zpm2.photos import pictures
from zpm2.photos.source import open_source

PHOTOGRAPHS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".jp2")


def photographs(folder: Path, suffixes: Sequence[str] = PHOTOGRAPHS) -> list[Path]:
    """The photographs of a folder in natural order, hidden files left out. `InputError` where the folder is missing."""
    found = (path for path in existing(folder).iterdir() if path.suffix.lower() in suffixes and path.name[0] != ".")
    return sorted(found, key=natural)


def some_photographs(folder: Path) -> list[Path]:
    """The photographs of a folder. Where there are none, `InputError` names the sub-folders that hold some."""
    found = photographs(folder)
    if found:
        return found
    inside = [path for path in folder.rglob("*") if path.suffix.lower() in PHOTOGRAPHS and path.is_file()]
    hidden = {path for path in inside if any(part[0] == "." for part in path.relative_to(folder).parts)}
    places = sorted({path.parent for path in set(inside) - hidden})
    if not places:
        raise InputError(f"{folder} holds no photographs ({', '.join(PHOTOGRAPHS)}): give the folder that does")
    named = f"{places[0]}" + (f" and {len(places) - 1} more sub-folders" if len(places) > 1 else "")
    raise InputError(
        f"{folder} holds no photographs itself, {named} do: give one of these folders, the photographs one by one, or "
        "with --cameras a COLMAP model that names them with their sub-folders"
    )


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) px of a photograph as its file stores it, from the header alone where possible."""
    found = pictures.header(path)
    if found is not None:
        return found[0]
    with closing(open_source(path)) as source:
        return source.width, source.height
