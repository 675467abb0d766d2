"""Segmenters by name (`zpm2.plugins`): the files of `zpm2.segment.methods`, and those of other packages.

A class or function makes one, with its networks loaded. It may have the parameters `config` (`SegmentConfig`), `device`
("cpu" or "cuda"), `say` (receives a line where something takes long), `progress` (the share of an image that is done,
0..1) and `download` (bytes of weights that are there, and all); its other parameters are options (`segment.options`):

    @segmenter("mine", ModelInfo(task="fields"))
    class Mine:
        def __init__(self, config: SegmentConfig, *, side: int = 32) -> None: ...
"""

from collections.abc import Callable

from zpm2.config import SegmentConfig
from zpm2.errors import WeightsError
from zpm2.plugins import Maker, ModelInfo, Models
from zpm2.segment.protocol import Segmenter
from zpm2.weights import Progress

SEGMENTERS = Models(
    "segmenter",
    "segmenters",
    "zpm2.segmenters",
    "zpm2.segment.methods",
    given=("config", "device", "say", "progress", "download"),
    options_key="segment.options",
)

NO_WEIGHTS = "classical"  # the segmenter that works without any


def segmenter(name: str, info: ModelInfo | None = None) -> Callable[[Maker], Maker]:
    """Register the class or function that makes the segmenter `name`. `ValueError` for a taken name."""
    return SEGMENTERS.add(name, info or ModelInfo())


def check_segmenter(config: SegmentConfig) -> None:
    """`ConfigError` for a name that is not in `SEGMENTERS`, and for options that do not exist."""
    SEGMENTERS.check([config.model], config.options)


def create(
    config: SegmentConfig,
    device: str = "cpu",
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float], None] = lambda share: None,
    download: Progress = lambda done, total: None,
) -> Segmenter:
    """The segmenter that `config` describes, loaded. Errors are those of `check_segmenter`, and `WeightsError` where
    weights cannot be had."""
    check_segmenter(config)
    given = {"config": config, "device": device, "say": say, "progress": progress, "download": download}
    try:
        made: Segmenter = SEGMENTERS.build(config.model, given, config.options)
    except WeightsError as error:
        raise WeightsError(f"{error}; without any weights: --segmenter {NO_WEIGHTS} --points sift") from error
    return made
