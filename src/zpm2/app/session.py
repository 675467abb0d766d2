"""What the server holds: the photographs of the pair, and the result that was opened."""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath
from time import perf_counter

import numpy as np

from zpm2.app.export import archive, region_of, result_of
from zpm2.app.pair import Pair
from zpm2.app.photograph import Photograph, read, received
from zpm2.app.prompt import prompt_of, shape_from, side_of
from zpm2.carry.result import attributes, vertices
from zpm2.config import Config
from zpm2.errors import InputError
from zpm2.formats import registry
from zpm2.formats.regions.outlines import parts_of
from zpm2.formats.regions.region import Shape
from zpm2.model import SIDES
from zpm2.pipeline import PairMatcher
from zpm2.result import MatchResult

GUIDES = 400  # homologous points that the page gets, to show where the cursor is in the other photograph
Answer = dict[str, object]  # a JSON object
Message = Mapping[str, object]  # the same from the browser, not checked


@dataclass
class Told:
    """How far the work is, for the page."""

    stage: str = ""
    share: float = 0.0

    def __call__(self, stage: str, share: float) -> None:
        """As `runtime.Progress`."""
        self.stage, self.share = stage, share


@dataclass
class Session:
    """One pair at a time. All but `describe` takes long, and is called from one thread at a time."""

    config: Config
    matcher: PairMatcher
    progress: Told
    photographs: list[Photograph | None] = field(default_factory=lambda: [None, None])
    opened: MatchResult | None = None
    number: int = 0  # of the pair; another one after each photograph that came
    _pair: Pair | None = None

    def describe(self) -> Answer:
        """What the page has to know first."""
        shown = [
            None if each is None else {"name": each.name, "width": each.width, "height": each.height}
            for each in self.photographs
        ]
        return {
            "number": self.number,
            "photographs": shown,
            "regions": [] if self.opened is None else _regions(self.opened),
            "formats": registry.names(),
        }

    def open(self, left: str | Path, right: str | Path) -> None:
        """The photographs of two paths. `InputError`."""
        self.photographs = [
            read(path, Path(path).name, side, self.config) for path, side in zip((left, right), SIDES, strict=True)
        ]
        self._changed()

    def open_result(self, folder: Path) -> None:
        """The photographs and matches of a folder that `zpm2 match` wrote. `InputError`."""
        result = MatchResult.load(folder)
        paths = [side.path for side in (result.left, result.right)]
        if None in paths:
            raise InputError(f"the photographs of {folder} were no files, so they are not there any more")
        self.open(str(paths[0]), str(paths[1]))
        for side, photograph, stored in zip(SIDES, self.photographs, (result.left, result.right), strict=True):
            if photograph is None or (photograph.width, photograph.height) != (stored.width, stored.height):
                raise InputError(f"the {side} image has another size than when it was matched; run zpm2 match again")
        self.opened = result

    def receive(self, side: int, name: str, content: bytes) -> Answer:
        """A photograph that the browser sent. It is on disk only while it is decoded. `InputError`."""
        name = PureWindowsPath(PurePosixPath(name).name).name or SIDES[side]
        with tempfile.TemporaryDirectory(prefix="zpm2-app-") as scratch:
            path = Path(scratch, "photograph")
            path.write_bytes(content)
            self.photographs[side] = received(path, name, SIDES[side], self.config)
        self.opened = None
        self._changed()
        return self.describe()

    def picture(self, side: int) -> bytes:
        """A photograph as WebP. `InputError` where there is none."""
        photograph = self.photographs[side]
        if photograph is None:
            raise InputError(f"there is no {SIDES[side]} photograph yet")
        return photograph.picture()

    def prepare(self, message: Message) -> Answer:
        """Looks at both photographs; homologous points of them, and what there is to tell."""
        start = perf_counter()
        pair = self._current(message)
        pair.prepare()
        points = pair.points
        some = np.unique(np.linspace(0, len(points) - 1, min(len(points), GUIDES)).astype(np.intp))
        guides = np.hstack([points.left[some], points.right[some]])
        return {
            "points": guides.round(2).tolist(),
            "messages": [str(each) for each in pair.messages],
            "seconds": _since(start),
        }

    def draw(self, message: Message) -> Answer:
        """The region that a prompt asks for."""
        start = perf_counter()
        found = self._current(message).draw(side_of(message), prompt_of(message.get("prompt")))
        return {
            "parts": _parts(found.shape),
            "score": round(found.score, 4),
            "size": found.size,
            "sizes": found.sizes,
            "seconds": _since(start),
        }

    def carry(self, message: Message) -> Answer:
        """A region of one photograph in the other one."""
        start = perf_counter()
        found = self._current(message).carry(side_of(message), shape_from(message.get("parts")))
        parts = None if found.shape is None else _parts(found.shape)
        return {**attributes(found), "parts": parts, "seconds": _since(start)}

    def export(self, message: Message) -> bytes:
        """The regions on which the person decided, as a ZIP file."""
        regions, formats = message.get("regions"), message.get("formats", [])
        if not isinstance(regions, list) or not isinstance(formats, list):
            raise InputError("regions and formats are lists")
        if not all(isinstance(each, str) for each in formats):
            raise InputError("formats are names")
        chosen = [region_of(each) for each in regions]
        return archive(result_of(self._current(message), chosen, self.opened), formats)

    def _current(self, message: Message) -> Pair:
        if message.get("number") != self.number:
            raise InputError("the photographs have changed: reload the page")
        if self._pair is None:
            left, right = self.photographs
            if left is None or right is None:
                raise InputError("there are not two photographs yet: drop both")
            self._pair = Pair((left, right), self.matcher, self.progress)
        return self._pair

    def _changed(self) -> None:
        self._pair = None
        self.number += 1


def made(config: Config, say: Callable[[str], None]) -> Session:
    """A session without photographs. `say` is told what takes long."""
    told = Told()
    return Session(config, PairMatcher(config, progress=told, say=say), told)


def _regions(result: MatchResult) -> list[Answer]:
    left, right = ({each.id: each for each in side.polygons} for side in (result.left, result.right))
    return [
        {
            "match": match.id,
            "label": left[match.left].label or right[match.right].label,
            "left": _parts(left[match.left].shape),
            "right": _parts(right[match.right].shape),
            "confidence": round(match.confidence, 4),
        }
        for match in result.matches
    ]


def _parts(shape: Shape) -> list[list[list[list[float]]]]:
    return [vertices(part) for part in parts_of(shape)]


def _since(start: float) -> float:
    return round(perf_counter() - start, 3)
