"""COLMAP's database: which images it matched. It is SQLite, so no further package is needed."""

import sqlite3
from contextlib import closing
from pathlib import Path

from zpm2.errors import InputError
from zpm2.files.listing import existing
from zpm2.files.reading import WRONG, regular

MAX_IMAGES = 2147483647  # pair_id = MAX_IMAGES * the smaller image id + the larger one


def verified_pairs(file: Path) -> list[tuple[str, str, int]]:
    """The names of each two images with verified matches, and how many, most first. `InputError` for a file that is no
    database of COLMAP, or has none."""
    try:
        place = regular(existing(file)).resolve().as_uri() + "?mode=ro"
        with closing(sqlite3.connect(place, uri=True)) as database:
            names = dict(database.execute("SELECT image_id, name FROM images"))
            rows = database.execute("SELECT pair_id, rows FROM two_view_geometries WHERE rows > 0").fetchall()
        found = [(str(names[pair // MAX_IMAGES]), str(names[pair % MAX_IMAGES]), int(rows)) for pair, rows in rows]
    except (OSError, sqlite3.Error, *WRONG) as error:
        raise InputError(f"{file} is not a complete database of COLMAP ({error}): give its database.db") from error
    if not found:
        raise InputError(f"{file} has no verified matches: run COLMAP's matcher first, or choose other --pairs")
    return sorted(found, key=lambda pair: (-pair[2], pair))
