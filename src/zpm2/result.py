"""What a run gives back: polygons, matches, points and geometry of a pair, as data and as JSON."""

import base64
import dataclasses
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.config import RasterConfig, recorded
from zpm2.errors import Failed, InputError
from zpm2.files.reading import WRONG
from zpm2.files.writing import claim
from zpm2.formats import gis, saving
from zpm2.formats.convert import Converter, Layout, Members
from zpm2.formats.detections import Detections, detections
from zpm2.formats.document import LAYOUTS
from zpm2.formats.layer import layers_of
from zpm2.formats.writers.geojson import feature_collections
from zpm2.local_match.exclusive import without_overlaps
from zpm2.local_match.outline import with_outlines
from zpm2.local_match.pair_map import matched_pairs, pair_maps
from zpm2.local_match.unmatched import without_smaller
from zpm2.model import Image, ImagePolygons, PointMatches, Polygon, PolygonArrays, PolygonMatch, SideName, counterparts
from zpm2.model.brief import brief
from zpm2.model.messages import split
from zpm2.photos import reopen
from zpm2.runtime import package_version
from zpm2.view import pictures as views
from zpm2.view import report as page

SCHEMA = "zpm2-matches/1"
ESTIMATES = {"fundamental": "fundamental matrix", "homography": "homography"}
PICTURE_WIDTH = 2400  # px, longest side of a picture
NOTEBOOK_WIDTH = 1600  # px, longest side of a picture in a notebook
SHEET_MATCHES = 100  # number of matches on a contact sheet


@dataclass(frozen=True, eq=False)
class MatchResult:
    """The matched pair. All coordinates are px of the original images, pixel centres at +0.5."""

    left: ImagePolygons
    right: ImagePolygons
    matches: Sequence[PolygonMatch]  # one-to-one, by ascending left id
    points: PointMatches
    fundamental: NDArray[np.float64] | Failed  # 3 x 3, p_right^T F p_left = 0
    homography: NDArray[np.float64] | Failed  # 3 x 3, p_right ~ H p_left
    config: Mapping[str, object] = field(repr=False)
    timings: Mapping[str, float] = field(repr=False)  # stage -> seconds
    warnings: Sequence[str] = ()  # what a user may have to act on
    notes: Sequence[str] = ()  # what was done on the way
    version: str = field(default_factory=package_version, repr=False)
    non_overlapping: bool = False  # matched polygons share no pixel (see `flatten`)
    same_scene: float | None = None  # 0..1, probability that both photographs show the same scene; None: not estimated

    __repr__ = brief

    def flatten(self) -> "MatchResult":
        """The same with matched regions that exclude each other in both images, to the pixel.

        If two matches overlap, one of them gets the pixels in both images: a part before the whole that contains it,
        otherwise the more confident match (`local_match.exclusive` has the rule). The rest of a polygon is one piece,
        traced along pixel edges, with its old id. A match is dropped, and its pixels go to the others, if one side
        keeps less than `segment.min_area` px or the two sides no longer correspond. Polygons without a match, including
        those of dropped matches, stay as they were and may overlap others. `parent` still names the polygon that
        contained each one before. Homologous vertices and outlines are left out, as they belong to the old exteriors.
        """
        pairs = self._pairs()
        config, maps = recorded(self.config), self._maps(pairs)
        left, right, matches = without_overlaps(self.left, self.right, self.matches, pairs, maps, config)
        gone, n = len(self.matches) - len(matches), len(self.matches)
        notes = [f"made non-overlapping, {gone} of {n} matches lost their regions"] if gone else []
        return dataclasses.replace(
            self, left=left, right=right, matches=matches, notes=[*self.notes, *notes], non_overlapping=True
        )

    def without_smaller(self, left: float, right: float) -> "MatchResult":
        """The same without polygons under `left` and `right` px^2 and their matches."""
        sides = without_smaller(self.left, self.right, self.matches, (left, right))
        return dataclasses.replace(self, left=sides[0], right=sides[1], matches=sides[2])

    def with_outlines(self, step: float = 2.0) -> "MatchResult":
        """The same with homologous points all around each matched pair of exteriors, about every `step` px.

        They are the `outline` of each match (`local_match.outline`). Parts that only one of the two outlines has show
        large residuals: drop them above a residual of your choice. `InputError` for a step that is not above 0.
        """
        pairs, options = self._pairs(), recorded(self.config).local_match.outline
        matches = with_outlines(self.matches, pairs, self._maps(pairs), self.fundamental, options, step)
        return dataclasses.replace(self, matches=matches)

    def matched_polygons(self) -> tuple[list[Polygon], list[Polygon]]:
        """The left and the right polygon of each match, in the order of `matches`."""
        pairs = self._pairs()
        return [left for left, _ in pairs], [right for _, right in pairs]

    def maps(self) -> NDArray[np.float64]:
        """(n, 3, 3) where a point of each match's left polygon should be: right ~ map @ left, image px
        (`local_match.pair_map`)."""
        return self._maps(self._pairs())

    def images(self) -> tuple[Image, Image]:
        """The photographs. `InputError` if the result was loaded and its photographs are no longer where they were."""
        raster = self._raster()
        return reopen.pixels(self.left, "left", raster), reopen.pixels(self.right, "right", raster)

    def to_dict(self) -> Members:
        """The content of `matches.json` (schema "zpm2-matches/1")."""
        return _CONVERTER.to_plain(self)

    def to_geojson(self) -> dict[str, Members]:
        """The polygons as two GeoJSON FeatureCollections, "left" and "right", with their partners' ids.

        Where a photograph has a reference system with longitude and latitude, in these (RFC 7946); else in image px,
        and marked so.
        """
        return feature_collections(self)

    def detections(self, side: SideName, masks: bool = True) -> Detections:
        """The polygons of a side as arrays: `supervision.Detections(**result.detections("left"))`. `tracker_id` is the
        number of the match. `InputError` where the masks do not fit into memory: then leave them out."""
        own = self.left if side == "left" else self.right
        return detections(own.polygons, counterparts(self.matches, side), (own.width, own.height), masks)

    def with_gis_messages(self) -> "MatchResult":
        """The same, with warnings about what files for a GIS will lack and notes on how they are made."""
        warnings, notes = split(gis.messages(layers_of(self)))
        return dataclasses.replace(self, warnings=[*self.warnings, *warnings], notes=[*self.notes, *notes])

    def plot(self, max_width: int = PICTURE_WIDTH) -> PIL.Image.Image:
        """Both images with matched polygons in the same colour and the same number; unmatched ones thin.

        `InputError` for a loaded result whose photographs are no longer where they were, or no longer of their size.
        """
        return PIL.Image.fromarray(views.overlay(self, self._raster(), max_width))

    def plot_unmatched(self, max_width: int = PICTURE_WIDTH) -> PIL.Image.Image:
        """Both images with the polygons that have no partner, coloured by why. `InputError` as from `plot`."""
        return PIL.Image.fromarray(views.unmatched(self, self._raster(), max_width))

    def contact_sheet(self, count: int = SHEET_MATCHES, seed: int = 0) -> PIL.Image.Image:
        """Up to `count` random matches, each with close-ups of its two polygons, to be judged by eye.

        Only the parts shown are read from the photographs. `InputError` as from `plot`.
        """
        return PIL.Image.fromarray(views.sheet(self, self._raster(), count, seed))

    def _repr_html_(self) -> str:
        """For notebooks: the line of `repr` and the overlay, or why there is no overlay."""
        line = f"<code>{html.escape(repr(self))}</code>"
        try:
            pixels = cv2.cvtColor(np.asarray(self.plot(NOTEBOOK_WIDTH)), cv2.COLOR_RGB2BGR)
        except InputError as error:
            return f"{line}<p>{html.escape(str(error))}</p>"
        picture = base64.b64encode(cv2.imencode(".jpg", pixels)[1].tobytes()).decode()
        return f'{line}<img alt="matched polygons" style="max-width: 100%" src="data:image/jpeg;base64,{picture}">'

    def report(self) -> str:
        """The page `report.html`: both photographs with their polygons to look at, filter and judge, as the HTML of one
        file that needs no network. `InputError` as from `plot`."""
        return page.report(self, self.to_dict(), self._raster())

    def save(
        self, directory: str | Path, formats: Sequence[str] = (), report: bool = False, pictures: bool = True
    ) -> Path:
        """Write matches.json, left.geojson, right.geojson, overlay.png and unmatched.png into a folder; returns it.

        Where a photograph is placed on the ground, matches.gpkg comes with them if pyogrio is installed; of large
        photographs a contact sheet, contact.png. `formats` asks for more: "gpkg", "shapefile" (left.shp, right.shp),
        "geoparquet" (left.parquet, right.parquet, matches.parquet), "coco" (left.coco.json, right.coco.json),
        "labelme", "cvat", "yolo" (left.labelme.json, left.cvat.xml, left.yolo.txt, ...), and any other of
        `formats.registry`; `report` asks for report.html; without `pictures` there are none, which saves most
        of the room that a result takes. Each file appears whole or not at all, and matches.json comes last: where it
        is, the others are. Files of an earlier result are replaced, others never. `OutputError` if the folder cannot be
        written or holds other files of these names, `ConfigError` for an unknown format, `MissingDependency` for one
        without its package, and `InputError` as from `plot`.
        """
        shown = views.all_pictures(self, self._raster(), PICTURE_WIDTH, SHEET_MATCHES) if pictures else {}
        return saving.save(self, directory, formats, shown, self._report if report else None)

    @staticmethod
    def load(path: str | Path) -> "MatchResult":
        """A result from a folder that `save` wrote, or from a matches.json.

        Its photographs are looked for where they were, seen from that folder, then at their absolute place: the result
        may be moved, with them or alone. `InputError` for anything else.
        """
        return read_result(path)[0]

    def _pairs(self) -> list[tuple[Polygon, Polygon]]:
        return matched_pairs(self.left, self.right, self.matches)

    def _maps(self, pairs: Sequence[tuple[Polygon, Polygon]]) -> NDArray[np.float64]:
        left, right = (PolygonArrays([pair[k] for pair in pairs]) for k in range(2))
        return pair_maps(left, right, self.points, self.homography, recorded(self.config).local_match)

    def _report(self, document: Members) -> saving.Files:
        return page.files(self, document, self._raster())

    def _raster(self) -> RasterConfig:
        """How the run read its photographs."""
        return recorded(self.config).raster


def read_result(path: str | Path) -> tuple[MatchResult, Members]:
    """`MatchResult.load`, and the document that the result was read from."""
    file, document = saving.read_document(path, SCHEMA)
    try:
        return _CONVERTER.from_plain(MatchResult, document), document
    except WRONG as error:
        raise saving.incomplete(file, error) from error


def save_report(directory: str | Path) -> Path:
    """Writes report.html into the folder of a saved result that lacks it; returns its path. `InputError` where there is
    no such result or a photograph is no longer where it was, `OutputError` where the folder cannot be written into."""
    result, document = read_result(directory)
    folder = claim(directory, [saving.REPORT, saving.TILES])
    saving.write_report(folder, result._report(document))
    return folder / saving.REPORT


def _fold(result: MatchResult, members: Members) -> Members:
    """Writes an estimate that does not exist as null, with its reason in "failed"."""
    failed = {name: str(made) for name in ESTIMATES if isinstance(made := getattr(result, name), Failed)}
    timings = {stage: round(seconds, 4) for stage, seconds in result.timings.items()}
    return members | dict.fromkeys(failed) | {"schema": SCHEMA, "failed": failed, "timings": timings}


def _unfold(members: Members) -> Members:
    members.setdefault("notes", [])  # earlier versions wrote none
    reasons = members.get("failed", {})
    for name, what in ESTIMATES.items():
        if members[name] is None:
            members[name] = Failed(str(reasons.get(name, f"the run found no {what}")))
    return members


_LAYOUT = Layout(
    order=(
        *("schema", "version", "config", "timings", "left", "right", "points", "fundamental", "homography", "failed"),
        *("same_scene", "non_overlapping", "matches", "warnings", "notes"),
    ),
    optional=("same_scene", "non_overlapping"),
    shapes={"fundamental": (3, 3), "homography": (3, 3)},
    fold=_fold,
    unfold=_unfold,
)
_CONVERTER = Converter({**LAYOUTS, MatchResult: _LAYOUT})
