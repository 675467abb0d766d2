"""The matchers of the package vismatch, in a process of its own."""

from zpm2.config import PointsConfig
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import point_matcher
from zpm2.plugins import ModelInfo


@point_matcher(
    "vismatch",
    ModelInfo(
        task="what vismatch's matcher of that name does",
        code_licence="BSD-3-Clause; each matcher has its own",
        weights_licence="each matcher has its own",
        training_data="see the matcher",
        input_size="see the matcher",
        variable="ZPM2_VISMATCH_PYTHON",
        bytes_per_pixel=4000.0,  # of the other process; not measured: that of Efficient LoFTR
    ),
)
def vismatch(config: PointsConfig, device: str, *, matcher: str) -> PointMatcher:
    """The matcher of that name (`points.options.matcher`); see `zpm2.features.vismatch`."""
    from zpm2.features.vismatch import VismatchMatcher

    return VismatchMatcher(matcher, config, device)
