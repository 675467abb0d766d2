"""How fast pairs are matched here: stage by stage, the first time and warm (`zpm2 bench`)."""

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from zpm2.api import Matcher
from zpm2.config import Config
from zpm2.errors import InputError, Zpm2Error
from zpm2.evaluate.predictions import peak_mb
from zpm2.files.reading import WRONG, read_json
from zpm2.files.writing import atomic_write
from zpm2.model import Image
from zpm2.photos.images import read_image
from zpm2.result import MatchResult
from zpm2.runtime import Progress, resolve_device

SCHEMA = "zpm2-speed/1"
TOTAL, OTHER = "total", "other"  # a whole call, and what of it is in no stage

Photographs = tuple[Path, Path]
Seconds = dict[str, float]  # by stage


@dataclass(frozen=True)
class PairSpeed:
    """One pair."""

    name: str
    size: str  # of both photographs
    matches: int
    first: Seconds  # of the first run, which may load networks
    warm: Seconds  # of the runs after it, the median of each stage


@dataclass(frozen=True)
class ManySpeed:
    """The same pairs through `Matcher.match_many`, without reading files."""

    pairs: int
    seconds: float
    ratio: float  # how much longer the same pairs take one after the other


@dataclass(frozen=True)
class Speed:
    """A report of `measure`."""

    environment: Mapping[str, str]
    config: Mapping[str, object]  # as JSON holds it
    runs: int  # warm ones of each pair
    pairs: Sequence[PairSpeed]
    many: ManySpeed | None
    peak_mb: int | None  # of the process; None where the system does not tell
    gpu_peak_mb: int | None  # None on a CPU

    @property
    def pairs_per_second(self) -> float:
        """Warm, one pair after the other."""
        return len(self.pairs) / max(sum(pair.warm[TOTAL] for pair in self.pairs), 1e-9)

    def save(self, file: Path) -> None:
        """Writes it as JSON."""
        atomic_write(file, json.dumps({"schema": SCHEMA, **dataclasses.asdict(self)}, indent=1))

    @staticmethod
    def load(file: Path) -> "Speed":
        """What `save` wrote; `InputError` for any other file."""
        try:
            values = read_json(file)
            if values.pop("schema") != SCHEMA:
                raise ValueError("another schema")
            values["pairs"] = [PairSpeed(**each) for each in values["pairs"]]
            values["many"] = values["many"] and ManySpeed(**values["many"])
            return Speed(**values)
        except OSError as error:
            raise InputError(f"{file} cannot be read ({error.strerror}): check the path") from error
        except (*WRONG, ValueError) as error:
            raise InputError(f"{file} is no report of zpm2 bench: give a file that zpm2 bench --json wrote") from error


def measure(
    pairs: Sequence[Photographs],
    config: Config,
    runs: int,
    many: bool = False,
    environment: Mapping[str, str] | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> Speed:
    """Match each pair 1 + `runs` times; with `many`, `runs` times again through `Matcher.match_many`.

    `environment` is added to what the report says of device and precision. Errors are those of `Matcher`, and
    `InputError` for fewer than one run.
    """
    if runs < 1:
        raise InputError(f"{runs} runs measure nothing: give 1 or more")
    device = resolve_device(config.device)
    matcher = Matcher(config, say=say)
    measured = []
    for k, pair in enumerate(pairs):
        times = []
        for run in range(1 + runs):
            progress("bench", (k + run / (1 + runs)) / len(pairs))
            result, seconds = _timed(matcher, pair)
            times.append(seconds)
        warm = {stage: median(each.get(stage, 0.0) for each in times[1:]) for stage in times[-1]}
        size = f"{result.left.width} x {result.left.height} and {result.right.width} x {result.right.height} px"
        name = f"{Path(pair[0]).name} - {Path(pair[1]).name}"
        measured.append(PairSpeed(name, size, len(result.matches), times[0], warm))
    together = _many(matcher, pairs, config, runs, measured) if many else None
    said = {"device": device, "precision": config.segment.precision, **(environment or {})}
    return Speed(
        said, json.loads(json.dumps(config.to_dict())), runs, measured, together, peak_mb(), _gpu_peak_mb(device)
    )


def _timed(matcher: Matcher, pair: Photographs) -> tuple[MatchResult, Seconds]:
    start = perf_counter()
    result = matcher(*pair)
    total = perf_counter() - start
    return result, {**result.timings, OTHER: total - sum(result.timings.values()), TOTAL: total}


def _many(
    matcher: Matcher, pairs: Sequence[Photographs], config: Config, runs: int, measured: Sequence[PairSpeed]
) -> ManySpeed:
    images = [tuple(read_image(photograph, config=config.raster) for photograph in pair) for pair in pairs]
    start = perf_counter()
    for result in matcher.match_many(_distinct(images, runs)):
        if isinstance(result, Zpm2Error):
            raise result
    seconds = perf_counter() - start
    alone = runs * sum(pair.warm[TOTAL] - pair.warm.get("read", 0.0) for pair in measured)
    return ManySpeed(runs * len(pairs), seconds, alone / seconds)


def _distinct(pairs: Sequence[tuple[Image, ...]], runs: int) -> Iterator[tuple[Image, Image]]:
    """Each pair so often, no photograph twice: one that is known already would take no time."""
    for run in range(runs):
        for left, right in pairs:
            yield _marked(left, run), _marked(right, run)


def _marked(image: Image, run: int) -> Image:
    """The photograph with other values of its first pixel in every run."""
    rgb = image.rgb.copy()
    rgb[0, 0] = np.frombuffer((run + 1).to_bytes(3, "little"), np.uint8)
    return dataclasses.replace(image, rgb=rgb)


def _gpu_peak_mb(device: str) -> int | None:
    if device != "cuda":
        return None
    import torch

    return int(torch.cuda.max_memory_reserved() // 2**20)


def text(speed: Speed, before: Speed | None = None) -> str:
    """The report for people, beside an earlier one: a ratio says how many times as fast it is now. `InputError` where
    the two have no pair in common."""
    lines = [", ".join(f"{name} {value}" for name, value in speed.environment.items())]
    earlier = {pair.name: pair for pair in before.pairs} if before else {}
    if before and not any(pair.name in earlier for pair in speed.pairs):
        raise InputError("the two reports have no pair in common: compare runs on photographs of the same names")
    if before:
        was = ", ".join(f"{name} {value}" for name, value in before.environment.items())
        lines.append(f"before: {was}")
        if before.config != speed.config:
            lines.append("before: with another configuration")
    for pair in speed.pairs:
        lines += ["", f"{pair.name}: {pair.size}, {pair.matches} matches", *_table(pair, earlier.get(pair.name))]
    lines += [
        "",
        f"{speed.pairs_per_second:.3g} pairs a second, one after the other (median of {speed.runs} warm runs)",
    ]
    if speed.many:
        rate = speed.many.pairs / speed.many.seconds
        lines.append(f"{rate:.3g} pairs a second by match_many ({speed.many.ratio:.2f} times as fast)")
    memory = "not known" if speed.peak_mb is None else f"{speed.peak_mb} MB"
    lines.append(
        f"peak memory {memory}" + ("" if speed.gpu_peak_mb is None else f", of the GPU {speed.gpu_peak_mb} MB")
    )
    return "\n".join(lines).rstrip()


def _table(pair: PairSpeed, before: PairSpeed | None) -> list[str]:
    lines = [f"  {'seconds':<10}{'first':>9}{'warm':>9}" + (f"{'before':>9}{'ratio':>8}" if before else "")]
    for stage, warm in pair.warm.items():
        line = f"  {stage:<10}{pair.first.get(stage, 0.0):9.3f}{warm:9.3f}"
        if before:
            was = before.warm.get(stage)
            ratio = f"{was / warm:8.2f}" if was is not None and warm > 5e-4 else f"{'-':>8}"
            line += (f"{'-':>9}" if was is None else f"{was:9.3f}") + ratio
        lines.append(line)
    return lines
