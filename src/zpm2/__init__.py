"""zpm2: polygon matching between two overlapping photographs, zero-shot.

    result = zpm2.match("left.png", "right.png")
    result.save("out")

Names are loaded when first used, so that `import zpm2` is quick and loads no network library.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from zpm2._version import __version__

if TYPE_CHECKING:
    from zpm2.config import Config, preset
    from zpm2.errors import Failed, Zpm2Error
    from zpm2.model import Polygon, PolygonMatch
    from zpm2.pipeline import PolygonMatcher
    from zpm2.result import MatchResult
    from zpm2.tiled import TiledMatcher, match

__all__ = [
    "Config",
    "Failed",
    "MatchResult",
    "Polygon",
    "PolygonMatch",
    "PolygonMatcher",
    "TiledMatcher",
    "Zpm2Error",
    "__version__",
    "match",
    "preset",
]

_HOME = {
    "Config": "zpm2.config",
    "Failed": "zpm2.errors",
    "MatchResult": "zpm2.result",
    "Polygon": "zpm2.model",
    "PolygonMatch": "zpm2.model",
    "PolygonMatcher": "zpm2.pipeline",
    "TiledMatcher": "zpm2.tiled",
    "Zpm2Error": "zpm2.errors",
    "match": "zpm2.tiled",
    "preset": "zpm2.config",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'zpm2' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
