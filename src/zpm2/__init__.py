"""zpm2: polygon matching between two overlapping photographs, zero-shot.

    result = zpm2.match("left.png", "right.png")
    result.save("out")

Names, and modules of the package (`zpm2.pose`, `zpm2.cloud`, ...), are loaded when first used, so that `import zpm2` is
quick and loads no network library.

OpenCV, where it is loaded afterwards, takes no more threads than `OMP_NUM_THREADS` or a quota of processor time allows
(`zpm2.cores.told`), which it does not know by itself. Where either is set cores are shared, so its threads then do not
keep them busy while they wait for work. What the environment already tells OpenCV stays.
"""

import os
import warnings
from importlib import import_module
from typing import TYPE_CHECKING

from zpm2.cores import told

if (_threads := told()) is not None:
    os.environ.setdefault("OPENCV_THREAD_POOL_ACTIVE_WAIT_WORKER", "0")
    if _threads < (os.cpu_count() or 1):
        os.environ.setdefault("OPENCV_FOR_THREADS_NUM", str(_threads))

if TYPE_CHECKING:
    from zpm2.api import Matcher, match
    from zpm2.config import Config, preset
    from zpm2.errors import Failed, Zpm2Error
    from zpm2.linking import LinkResult, link
    from zpm2.model import Polygon, PolygonMatch
    from zpm2.result import MatchResult
    from zpm2.tracking import TracksResult, tracks

    __version__: str

__all__ = [
    "Config",
    "Failed",
    "LinkResult",
    "MatchResult",
    "Matcher",
    "Polygon",
    "PolygonMatch",
    "TracksResult",
    "Zpm2Error",
    "__version__",
    "link",
    "match",
    "preset",
    "tracks",
]

_HOME = {
    "Config": "zpm2.config",
    "Failed": "zpm2.errors",
    "LinkResult": "zpm2.linking",
    "MatchResult": "zpm2.result",
    "Polygon": "zpm2.model",
    "PolygonMatch": "zpm2.model",
    "Matcher": "zpm2.api",
    "Zpm2Error": "zpm2.errors",
    "link": "zpm2.linking",
    "match": "zpm2.api",
    "preset": "zpm2.config",
    "tracks": "zpm2.tracking",
    "TracksResult": "zpm2.tracking",
}

_DEPRECATED = {"PolygonMatcher": "Matcher", "TiledMatcher": "Matcher"}  # earlier names, until version 1.0


def __getattr__(name: str) -> object:
    if name == "__version__":
        return import_module("zpm2.runtime").package_version()
    if name in _DEPRECATED:
        now = _DEPRECATED[name]
        warnings.warn(f"zpm2.{name} is now called zpm2.{now}", DeprecationWarning, stacklevel=2)
        name = now
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if not name.startswith("_"):
        try:
            return import_module(f"zpm2.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"zpm2.{name}":
                raise
    raise AttributeError(f"module 'zpm2' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
