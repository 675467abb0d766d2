"""Point matchers by name (`zpm2.plugins`): the files of `zpm2.features.methods`, and those of other packages.

A class or function makes one. It may have the parameters `config` (`PointsConfig`), `device` ("cpu" or "cuda") and
`progress` (of downloads, or None); its other parameters are options (`points.options`):

    @point_matcher("mine", ModelInfo(task="corners"))
    def mine(config: PointsConfig, device: str, *, radius: int = 3) -> PointMatcher: ...
"""

from collections.abc import Callable

from zpm2.config import PointsConfig
from zpm2.errors import ConfigError
from zpm2.features.combined import CombinedMatcher
from zpm2.features.protocol import PointMatcher
from zpm2.model.messages import Note
from zpm2.plugins import Maker, ModelInfo, Models
from zpm2.weights import Progress, hash_note

METHODS = Models(
    "point method",
    "methods",
    "zpm2.point_matchers",
    "zpm2.features.methods",
    given=("config", "device", "progress"),
    options_key="points.options",
)


def point_matcher(name: str, info: ModelInfo | None = None) -> Callable[[Maker], Maker]:
    """Register the class or function that makes the matcher `name`. `ValueError` for a taken name."""
    return METHODS.add(name, info or ModelInfo())


def create(config: PointsConfig, device: str = "cpu", progress: Progress | None = None) -> PointMatcher:
    """The matcher that `config` describes: one method, or several with their matches together.

    `device` is "cpu" or "cuda"; SIFT always runs on the CPU. The same images always give the same points. `progress`
    reports downloads. Raises `ConfigError` for a name that is not in `METHODS` or an option that does not exist, before
    anything is loaded, and `WeightsError` where weights cannot be had.
    """
    check_methods(config)
    return combined(config, device, progress)


def combined(config: PointsConfig, device: str, progress: Progress | None = None) -> PointMatcher:
    """The same for options of which a method takes only some, and which were checked before."""
    given = {"config": config, "device": device, "progress": progress}
    matchers = [METHODS.build(name, given, config.options) for name in config.methods]
    return CombinedMatcher(matchers, config.min_score, config.merge_px)


def seen_size(config: PointsConfig) -> int:
    """Px, the longer side at which the learned matchers see photographs; of several, the smallest."""
    return min(config.side(_trained_for(name)) for name in config.methods)


def _trained_for(name: str) -> int:
    try:
        return METHODS.get(name).info.longest_side
    except ConfigError:  # points of a saved result, found by what is not here
        return 0


def check_methods(config: PointsConfig) -> None:
    """`ConfigError` for a name that is not in `METHODS`, and for options that do not exist."""
    METHODS.check(config.methods, config.options)


def weights_notes(config: PointsConfig) -> list[str]:
    """Notes for the user on weights of these methods whose hash zpm2 does not know."""
    used = dict.fromkeys(name for method in config.methods for name in METHODS.get(method).info.weights)
    return [Note(text) for text in map(hash_note, used) if text is not None]
