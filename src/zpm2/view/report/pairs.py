"""The page of many pairs: a table with a thumbnail and a link for each."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from zpm2.view.report.assets import data_url, render


@dataclass(frozen=True)
class Column:
    """A number of each pair."""

    name: str  # in the data
    title: str
    meaning: str
    digits: int = 0


@dataclass(frozen=True)
class Row:
    """A pair."""

    name: str
    link: str | None  # its report, seen from the page; None where it has none
    remark: str  # what went wrong, empty where nothing did
    thumbnail: bytes | None  # WebP
    values: dict[str, float | None]  # by column


def page(title: str, about: str, columns: Sequence[Column], rows: Sequence[Row]) -> str:
    """The HTML of the page; rows in the order in which they are first shown. The same rows give the same text."""
    shown = [
        {
            "name": row.name,
            "link": row.link,
            "remark": row.remark,
            "thumbnail": data_url("image/webp", row.thumbnail) if row.thumbnail else None,
            "values": row.values,
        }
        for row in rows
    ]
    data = {"columns": [asdict(column) for column in columns], "rows": shown}
    return render("pairs.html", "pairs.js", data, title=title, about=about)
