"""What segmenters and point matchers there are, what each needs, and how fast it is on this machine.

python -m zpm2.evaluate.models segmenter NAME    # seconds and memory as JSON, in a process of its own
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

from zpm2 import weights
from zpm2.config import preset
from zpm2.errors import ConfigError, Zpm2Error
from zpm2.evaluate.kinds import kind_of
from zpm2.evaluate.predictions import peak_mb
from zpm2.features.registry import METHODS
from zpm2.plugins import ModelInfo, Models
from zpm2.segment.registry import SEGMENTERS

REGISTRIES: dict[str, Models] = {"segmenter": SEGMENTERS, "point matcher": METHODS}
SCENE = 960, 540  # px, the pair of `zpm2 demo`, on which models are measured


@dataclass(frozen=True)
class Measured:
    """One image segmented, or one pair of images matched, by a new process."""

    load: float  # s, until the model was ready
    seconds: float  # s, of the image or the pair
    peak_mb: int | None  # of the whole process; None where the system does not tell
    found: int  # regions or points


@dataclass(frozen=True)
class ModelRow:
    """A segmenter or point matcher on this machine."""

    kind: str  # a name of `REGISTRIES`
    name: str
    origin: str
    info: ModelInfo
    weights_licence: str  # "none" where there are no weights
    size: int | None  # bytes of its weights; None: not known
    missing: tuple[str, ...]  # what it needs and is not here, as commands that bring it
    measured: Measured | str | None = None  # a text: why it could not be measured

    @property
    def here(self) -> bool:
        """Whether it can be used without a download."""
        return not self.missing


def rows(names: Sequence[str] = ()) -> list[ModelRow]:
    """All segmenters and point matchers, or those of these names or dotted paths. No model is loaded. `ConfigError` for
    a name that does not exist or a package that cannot be used; without names such a package is left out, with a
    `PluginWarning`."""
    if not names:
        return [_row(kind, name) for kind, models in REGISTRIES.items() for name, _ in models.items()]
    return [_row(kind, name) for name in dict.fromkeys(names) for kind in _kinds(name)]


def measure(row: ModelRow) -> ModelRow:
    """The row with what one image or pair takes, in a fresh process. `measured` is the reason where it fails."""
    command = [sys.executable, "-m", "zpm2.evaluate.models", row.kind, row.name]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    if done.returncode == 0 and lines:
        return replace(row, measured=Measured(**json.loads(lines[-1])))
    said = done.stderr.strip().splitlines()
    return replace(row, measured=said[-1] if said else f"its process ended with {done.returncode}")


def measure_here(kind: str, name: str) -> Measured:
    """One image or pair of the scene, in this process."""
    from zpm2.evaluate.rendered import render_scene
    from zpm2.features import create as create_points
    from zpm2.model import Image
    from zpm2.runtime import resolve_device
    from zpm2.segment.registry import create as create_segmenter

    config = preset("default")
    device = resolve_device(config.device)
    scene = render_scene(0, *SCENE)
    left, right = Image(scene.left), Image(scene.right)
    start = perf_counter()
    if kind == "segmenter":
        segmenter = create_segmenter(replace(config.segment, model=name), device)
        loaded = perf_counter()
        found = len(segmenter.segment(left))
    else:
        matcher = create_points(replace(config.points, methods=(name,)), device)
        loaded = perf_counter()
        found = len(matcher.match(left, right))
    end = perf_counter()
    return Measured(round(loaded - start, 2), round(end - loaded, 2), peak_mb(), found)


def _kinds(name: str) -> list[str]:
    """Usually one; a segmenter and a point matcher may have the same name."""
    kinds = [kind_of(name)] if ":" in name else [kind for kind, models in REGISTRIES.items() if name in models]
    if not kinds or kinds[0] not in REGISTRIES:
        raise ConfigError(f"'{name}' is a {kind_of(name)}: give segmenters and point matchers, or --all without names")
    return list(kinds)


def _row(kind: str, name: str) -> ModelRow:
    models = REGISTRIES[kind]
    info = models.get(name).info
    places = {status.entry.name: status for status in weights.status()}
    missing = [f"weights {each}, which zpm2 does not know" for each in info.weights if each not in places]
    known = [places[each] for each in info.weights if each in places]
    absent = [status.entry for status in known if status.path is None]
    missing += [f"zpm2 weights get {e.name}{'' if e.commercial_use else ' --accept-licence'}" for e in absent]
    if info.missing_packages():
        missing.append(info.install)
    if info.variable and info.variable not in os.environ:
        missing.append(f"the environment variable {info.variable} (docs/points.md)")
    licences = dict.fromkeys(status.entry.licence for status in known)
    return ModelRow(
        kind,
        name,
        models.origin(name),
        info,
        info.weights_licence or ", ".join(licences) or ("unknown" if models.origin(name) != "built in" else "none"),
        sum(status.entry.size for status in known)
        if len(known) == len(info.weights) and all(status.entry.hash_known for status in known)
        else None,
        tuple(missing),
    )


def _main(words: Sequence[str]) -> int:
    kind, name = words
    try:
        found = measure_here(kind, name)
    except Zpm2Error as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(vars(found)))
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
