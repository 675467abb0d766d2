"""What a run gives back: polygons, matches, points, geometry; to files and back, as a picture, and made exclusive."""

import base64
import contextlib
import dataclasses
import html
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2._version import __version__
from zpm2.config import recorded
from zpm2.errors import Failed, InputError
from zpm2.files.places import find, place
from zpm2.files.reading import WRONG, read_json
from zpm2.files.writing import atomic_write, claim
from zpm2.formats import geojson, gis
from zpm2.formats.coco import coco
from zpm2.formats.document import (
    match_from_dict,
    match_to_dict,
    matrix_from_list,
    matrix_to_list,
    points_from_dict,
    points_to_dict,
    side_from_dict,
    side_to_dict,
)
from zpm2.formats.layer import Layer, feature_collection
from zpm2.local_match.exclusive import exclusive
from zpm2.local_match.outline import outline_correspondence
from zpm2.local_match.pair_map import pair_maps
from zpm2.model import Image, ImagePolygons, PointMatches, Polygon, PolygonArrays, PolygonMatch, counterparts
from zpm2.model.brief import brief
from zpm2.model.messages import split
from zpm2.photos.source import InMemoryPhoto, Source, open_source, reduced
from zpm2.polygons.rasterize import rasterize
from zpm2.view.contact import Crop, contact_sheet, crop_window
from zpm2.view.overlay import overlay, unmatched

SideName = Literal["left", "right"]
SIDES: tuple[SideName, SideName] = ("left", "right")
SCHEMA = "zpm2-matches/1"
ESTIMATES = {"fundamental": "fundamental matrix", "homography": "homography"}
FORMATS = ("gpkg", "shapefile", "coco")  # of files that `save` writes when asked for
SHEET = 100  # matches on a contact sheet
NOTEBOOK = 1600  # px, the longest side of an overlay in a notebook
NAMES = (
    *("left.geojson", "right.geojson", "overlay.png", "unmatched.png", "contact.png", "matches.json"),
    *(f"matches.gpkg{suffix}" for suffix in ("", *gis.LOG_FILES)),
)
MORE_NAMES = {  # of files that a format adds
    "gpkg": (),
    "shapefile": tuple(f"{side}{suffix}" for side in SIDES for suffix in gis.SIDE_FILES),
    "coco": ("left.coco.json", "right.coco.json"),
}
CROP = 300  # px, the longest side at which a crop of it is read


@dataclass(frozen=True, eq=False)
class MatchResult:
    """The matched pair. All coordinates are px of the original images, pixel centres at +0.5."""

    left: ImagePolygons
    right: ImagePolygons
    matches: Sequence[PolygonMatch]  # one-to-one, by ascending left id
    points: PointMatches
    fundamental: NDArray[np.float64] | Failed  # 3 x 3, p_right^T F p_left = 0
    homography: NDArray[np.float64] | Failed  # 3 x 3, p_right ~ H p_left
    config: Mapping[str, Any] = field(repr=False)
    timings: Mapping[str, float] = field(repr=False)  # stage -> seconds
    warnings: Sequence[str] = ()  # what a user may have to act on
    notes: Sequence[str] = ()  # what was done on the way
    version: str = field(default=__version__, repr=False)
    non_overlapping: bool = False  # matched polygons share no pixel (see `flatten`)

    __repr__ = brief

    def flatten(self) -> "MatchResult":
        """The same with matched regions that exclude each other in both images, to the pixel.

        Where two matches overlap, the same one gets the pixels on both sides: the surer match, but a part before the
        whole that it lies in. What is left of a polygon, one piece without what was taken, is traced along pixel edges
        under its old id; matches of which one side keeps less than `segment.min_area` px, or of which the two sides do
        not correspond any more, go, and leave their pixels to the others (`local_match.exclusive` has the rule). Their
        polygons and unmatched ones stay listed as they were, and may overlap anything; `parent` still says what lay in
        what before. Homologous vertices and outlines were those of the old exteriors, and are left out.
        """
        pairs = self._pairs()
        confidence = np.array([match.confidence for match in self.matches], np.float64)
        sizes = (self.left.width, self.left.height), (self.right.width, self.right.height)
        config = recorded(self.config)
        kept = exclusive(
            pairs, confidence, self._maps(pairs), sizes, config.segment.min_area, config.local_match.exclusive
        )
        matches = [
            dataclasses.replace(match, nodes=np.zeros((0, 2), np.int64), outline=np.zeros((0, 5)))
            for match, pair in zip(self.matches, kept, strict=True)
            if pair is not None
        ]
        gone = len(self.matches) - len(matches)
        lost = [(m.left, m.right) for m, pair in zip(self.matches, kept, strict=True) if pair is None]
        notes = [f"made non-overlapping, {gone} of {len(self.matches)} matches lost their regions"] if gone else []
        return dataclasses.replace(
            self,
            left=_with_polygons(self.left, [pair[0] for pair in kept if pair is not None], [a for a, _ in lost]),
            right=_with_polygons(self.right, [pair[1] for pair in kept if pair is not None], [b for _, b in lost]),
            matches=matches,
            notes=[*self.notes, *notes],
            non_overlapping=True,
        )

    def without_smaller(self, left: float, right: float) -> "MatchResult":
        """The same without polygons under `left` and `right` px^2 and their matches."""
        kept = [
            [polygon for polygon in side.polygons if polygon.area >= least]
            for side, least in ((self.left, left), (self.right, right))
        ]
        ids = [{polygon.id for polygon in polygons} for polygons in kept]
        alone = [
            dict.fromkeys((getattr(m, own) for m in self.matches if getattr(m, other) not in known), "no candidate")
            for own, other, known in (("left", "right", ids[1]), ("right", "left", ids[0]))
        ]
        return dataclasses.replace(
            self,
            left=_only(self.left, kept[0], alone[0]),
            right=_only(self.right, kept[1], alone[1]),
            matches=[match for match in self.matches if match.left in ids[0] and match.right in ids[1]],
        )

    def with_outlines(self, step: float = 2.0) -> "MatchResult":
        """The same with homologous points all around each matched pair of exteriors, about every `step` px: the
        `outline` of each match (`local_match.outline`). Cut at a residual of your choice what one outline has and the
        other has not."""
        if not step > 0:
            raise InputError(f"outlines are sampled every {step} px: give a step above 0")
        pairs, options = self._pairs(), recorded(self.config).local_match.outline
        fundamental = None if isinstance(self.fundamental, Failed) else self.fundamental
        matches = [
            dataclasses.replace(
                match, outline=outline_correspondence(left.exterior, right.exterior, matrix, options, step, fundamental)
            )
            for match, (left, right), matrix in zip(self.matches, pairs, self._maps(pairs), strict=True)
        ]
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
        """The photographs; `InputError` for a loaded result of which they are no longer where they were."""
        return _pixels(self.left, "left", self.config), _pixels(self.right, "right", self.config)

    def _pairs(self) -> list[tuple[Polygon, Polygon]]:
        """The polygons of each match."""
        left, right = ({polygon.id: polygon for polygon in side.polygons} for side in (self.left, self.right))
        for match in self.matches:
            if match.left not in left or match.right not in right:
                raise InputError(f"match {match.left} - {match.right} names a polygon that the result does not have")
        return [(left[match.left], right[match.right]) for match in self.matches]

    def _maps(self, pairs: Sequence[tuple[Polygon, Polygon]]) -> NDArray[np.float64]:
        """(n, 3, 3) the map of each of n matched pairs."""
        left, right = (PolygonArrays([pair[k] for pair in pairs]) for k in range(2))
        return pair_maps(left, right, self.points, self.homography, recorded(self.config).local_match)

    def to_dict(self) -> dict[str, Any]:
        """The content of `matches.json` (schema "zpm2-matches/1")."""
        return {
            "schema": SCHEMA,
            "version": self.version,
            "config": dict(self.config),
            "timings": {stage: round(seconds, 4) for stage, seconds in self.timings.items()},
            "left": side_to_dict(self.left),
            "right": side_to_dict(self.right),
            "points": points_to_dict(self.points),
            "fundamental": matrix_to_list(self.fundamental),
            "homography": matrix_to_list(self.homography),
            "failed": {name: str(m) for name in ESTIMATES if isinstance(m := getattr(self, name), Failed)},
            "non_overlapping": self.non_overlapping,
            "matches": [match_to_dict(match) for match in self.matches],
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def to_geojson(self) -> dict[str, dict[str, Any]]:
        """The polygons as two GeoJSON FeatureCollections, "left" and "right", with their partners' ids: of a
        photograph that its file places on the ground, in longitude and latitude (RFC 7946), of others, or where its
        reference system has none, in image px and marked so."""
        return {name: self._side_geojson(name) for name in SIDES}

    def _side_geojson(self, name: SideName) -> dict[str, Any]:
        layer = self._layer(name)
        if layer.crs is not None:
            with contextlib.suppress(InputError):  # no longitude and latitude: the run has said so
                return feature_collection(layer)
        side: ImagePolygons = getattr(self, name)
        image = side.path or name, side.width, side.height
        return geojson.feature_collection(side.polygons, layer.match_of, *image, side.unmatched)

    def with_gis_messages(self) -> "MatchResult":
        """The same, with warnings of what files for a GIS will miss and notes of how they are made."""
        warnings, notes = split(gis.messages([self._layer(name) for name in SIDES]))
        return dataclasses.replace(self, warnings=[*self.warnings, *warnings], notes=[*self.notes, *notes])

    def _layer(self, name: SideName) -> Layer:
        """One side for a GIS."""
        side: ImagePolygons = getattr(self, name)
        return Layer(name, side.polygons, side.geo, counterparts(self.matches, name), side.unmatched)

    def _coco(self, name: SideName) -> dict[str, Any]:
        side: ImagePolygons = getattr(self, name)
        masks = (rasterize(polygon.shape) for polygon in side.polygons)
        image = side.path or name, side.width, side.height
        return coco(side.polygons, masks, counterparts(self.matches, name), *image, side.unmatched)

    def plot(self, max_width: int = 2400) -> PIL.Image.Image:
        """Both images with matched polygons in the same colour and the same number; unmatched ones thin.

        `InputError` for a loaded result whose photographs are no longer where they were, or no longer of their size.
        """
        return PIL.Image.fromarray(overlay(*self._shown(max_width), self.matches, max_width, self._sizes()))

    def plot_unmatched(self, max_width: int = 2400) -> PIL.Image.Image:
        """Both images with the polygons that have no partner, coloured by why. `InputError` as from `plot`."""
        reasons = self.left.unmatched, self.right.unmatched
        return PIL.Image.fromarray(unmatched(*self._shown(max_width), self.matches, reasons, max_width, self._sizes()))

    def _shown(self, longest: int) -> tuple[Image, Image, Sequence[Polygon], Sequence[Polygon]]:
        """The photographs, `longest` px or more, and their polygons."""
        left, right = (
            _pixels(self.left, "left", self.config, longest),
            _pixels(self.right, "right", self.config, longest),
        )
        return left, right, self.left.polygons, self.right.polygons

    def _sizes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return (self.left.width, self.left.height), (self.right.width, self.right.height)

    def _repr_html_(self) -> str:
        """For notebooks: the line of `repr` and the overlay, or why there is no overlay."""
        line = f"<code>{html.escape(repr(self))}</code>"
        try:
            pixels = cv2.cvtColor(np.asarray(self.plot(NOTEBOOK)), cv2.COLOR_RGB2BGR)
        except InputError as error:
            return f"{line}<p>{html.escape(str(error))}</p>"
        picture = base64.b64encode(cv2.imencode(".jpg", pixels)[1].tobytes()).decode()
        return f'{line}<img alt="matched polygons" style="max-width: 100%" src="data:image/jpeg;base64,{picture}">'

    def contact_sheet(self, count: int = SHEET, seed: int = 0) -> PIL.Image.Image:
        """Up to `count` random matches, each with its two polygons close up, to be judged by eye.

        Only what is shown is read. `InputError` as from `plot`.
        """
        chosen = np.random.default_rng(seed).permutation(len(self.matches))[:count]
        matches = [self.matches[k] for k in sorted(chosen)]
        crops = []
        for name in ("left", "right"):
            side: ImagePolygons = getattr(self, name)
            polygons = {polygon.id: polygon for polygon in side.polygons}
            with _opened(side, name, self.config) as source:
                crops.append([_crop(source, side, polygons[getattr(match, name)]) for match in matches])
        captions = [f"match {match.id}   (right {match.right})   {match.confidence:.2f}" for match in matches]
        return PIL.Image.fromarray(contact_sheet(list(zip(*crops, strict=True)), captions))

    def save(self, directory: str | Path, formats: Sequence[str] = ()) -> Path:
        """Write matches.json, left.geojson, right.geojson, overlay.png and unmatched.png into a folder; returns it.

        Where a photograph is placed on the ground, matches.gpkg comes with them if pyogrio is installed; of large
        photographs a contact sheet, contact.png. `formats` asks for more: "gpkg", "shapefile" (left.shp, right.shp),
        "coco" (left.coco.json, right.coco.json). Each file appears whole or not at all, and matches.json comes last:
        where it is, the others are. Files of an earlier result are replaced, others never. `OutputError` if the folder
        cannot be written or holds other files of these names, `MissingDependency` for a format without its package, and
        `InputError` as from `plot`.
        """
        photographs = [side.path for side in (self.left, self.right) if side.path is not None]
        pictures = {"overlay": self.plot(), "unmatched": self.plot_unmatched()}
        if any(side.image is not None and side.image.width < side.width for side in (self.left, self.right)):
            pictures["contact"] = self.contact_sheet()
        folder = claim(directory, file_names(formats), photographs)
        for name, collection in self.to_geojson().items():
            geojson.write(folder / f"{name}.geojson", collection)
        layers = self._layer("left"), self._layer("right")
        if "gpkg" in formats or (gis.has_pyogrio() and any(layer.crs is not None for layer in layers)):
            gis.write_geopackage(folder / "matches.gpkg", *layers, self.matches)
        if "shapefile" in formats:
            for layer in layers:
                gis.write_shapefile(folder, layer)
        if "coco" in formats:
            for name in SIDES:
                atomic_write(folder / f"{name}.coco.json", json.dumps(self._coco(name)))
        for name, picture in pictures.items():
            pixels = cv2.cvtColor(np.asarray(picture), cv2.COLOR_RGB2BGR)
            atomic_write(folder / f"{name}.png", cv2.imencode(".png", pixels)[1].tobytes())
        document = self.to_dict()
        for name in SIDES:
            document[name] |= place(document[name]["path"], folder)
        atomic_write(folder / "matches.json", json.dumps(document, allow_nan=False))
        return folder

    @staticmethod
    def load(path: str | Path) -> "MatchResult":
        """A result from a folder that `save` wrote, or from a matches.json.

        Its photographs are looked for where they were, seen from that folder, then at their absolute place: the result
        may be moved, with them or alone. `InputError` for anything else.
        """
        path = Path(path)
        file = path / "matches.json" if os.path.isdir(path) else path
        try:
            document = read_json(file)
        except OSError as error:
            raise InputError(f"cannot read {file}: {error.strerror}; give the folder that zpm2 match wrote") from error
        except ValueError as error:
            raise InputError(f"{file} is no JSON: {error}; run zpm2 match again") from error
        if not isinstance(document, dict) or document.get("schema") != SCHEMA:
            raise InputError(f"{file} is no {SCHEMA} file; give the folder that zpm2 match wrote")
        try:
            for name in SIDES:
                document[name]["path"] = find(document[name], file.parent)
            return _from_dict(document)
        except WRONG as error:
            raise InputError(f"{file} is not complete ({error!r}); run zpm2 match again") from error


def file_names(formats: Sequence[str] = ()) -> list[str]:
    """The names of all files that `MatchResult.save` may write."""
    return [*NAMES, *(name for kind in formats for name in MORE_NAMES[kind])]


def _only(side: ImagePolygons, polygons: Sequence[Polygon], alone: Mapping[int, str]) -> ImagePolygons:
    """The side with no other polygons than these; a parent that is not among them is none. `alone` says why those have
    no partner whose partner went."""
    ids = {polygon.id for polygon in polygons}
    adopted = [p if p.parent is None or p.parent in ids else dataclasses.replace(p, parent=None) for p in polygons]
    unmatched = {id: why for id, why in {**side.unmatched, **alone}.items() if id in ids}
    return dataclasses.replace(side, polygons=adopted, unmatched=unmatched)


def _with_polygons(side: ImagePolygons, polygons: Sequence[Polygon], lost: Sequence[int]) -> ImagePolygons:
    """The side with `polygons` in the place of those that have their ids; those of the ids `lost` have no partner any
    more."""
    new = {polygon.id: polygon for polygon in polygons}
    unmatched = {**side.unmatched, **dict.fromkeys(lost, "rejected")}
    return dataclasses.replace(
        side, polygons=[new.get(polygon.id, polygon) for polygon in side.polygons], unmatched=unmatched
    )


def _from_dict(document: Mapping[str, Any]) -> MatchResult:
    reasons = document.get("failed", {})
    fundamental, homography = (
        matrix_from_list(document[name], str(reasons.get(name, f"the run found no {what}")))
        for name, what in ESTIMATES.items()
    )
    return MatchResult(
        left=side_from_dict(document["left"]),
        right=side_from_dict(document["right"]),
        matches=[match_from_dict(match) for match in document["matches"]],
        points=points_from_dict(document["points"]),
        fundamental=fundamental,
        homography=homography,
        config=dict(document["config"]),
        timings={stage: float(seconds) for stage, seconds in document["timings"].items()},
        warnings=list(document["warnings"]),
        notes=list(document.get("notes", [])),
        version=document["version"],
        non_overlapping=document.get("non_overlapping") is True,
    )


def _pixels(side: ImagePolygons, name: str, config: Mapping[str, Any], longest: int | None = None) -> Image:
    """The photograph of a side, or a version of it reduced to `longest` px or more where that is at hand."""
    if side.image is not None and (longest is not None or side.image.width == side.width):
        return side.image
    with _opened(side, name, config) as source:
        return source.read() if longest is None else reduced(source, longest)


@contextlib.contextmanager
def _opened(side: ImagePolygons, name: str, config: Mapping[str, Any]) -> Iterator[Source]:
    """The photograph of a side: the pixels that the result holds, where they are all of it or all there is."""
    if side.image is not None and (side.image.width == side.width or side.path is None):
        yield InMemoryPhoto(side.image)
        return
    if side.path is None:
        raise InputError(f"the {name} photograph was given as pixels and is not part of the saved result")
    raster = config.get("raster")
    source = open_source(side.path, f"{name} image", raster["bands"] if isinstance(raster, Mapping) else ())
    try:
        if (source.width, source.height) != (side.width, side.height):
            raise InputError(
                f"{name} image {side.path} has {source.width} x {source.height} px and had {side.width} x "
                f"{side.height} px when it was matched; run zpm2 match again"
            )
        yield source
    finally:
        source.close()


def _crop(source: Source, side: ImagePolygons, polygon: Polygon) -> Crop:
    """A polygon's surroundings; `source` may be a reduced version of the photograph."""
    scale = source.width / side.width
    rings = [ring * scale for ring in (polygon.exterior, *polygon.holes)]
    bounds = *rings[0].min(0), *rings[0].max(0)
    x0, y0, x1, y1 = window = crop_window(bounds, source.width, source.height)
    reduction = max(1.0, max(x1 - x0, y1 - y0) / CROP)
    size = max(1, round((x1 - x0) / reduction)), max(1, round((y1 - y0) / reduction))
    factor = np.array(size) / (x1 - x0, y1 - y0)
    return Crop(source.read(window, size), [(ring - (x0, y0)) * factor for ring in rings])
