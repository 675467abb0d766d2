"""How much memory a pair takes, estimated from its size and the configuration before anything is loaded.

The numbers are measured, rounded up, and hold for a whole process. Those of segmenters and point matchers are given
where these are registered (`zpm2.plugins.ModelInfo`). They were measured with photographs of 1.4 megapixels (xfeat and
SIFT: 12).
"""

from collections.abc import Sequence

from zpm2 import memory
from zpm2.config import Config, PointsConfig
from zpm2.features import METHODS
from zpm2.segment.registry import SEGMENTERS

Size = tuple[int, int]  # (width, height) px

# Bytes that a process which matches one pair takes at its peak, each rounded up. Measured as the
# largest resident set of fresh processes of `zpm2 match --tiles off`, Linux, two cores, OpenVINO, the scene of `zpm2
# demo` enlarged. Of photographs of 1, 4, 12 and 25 megapixels each, in MiB: preset default 1775, 1833, 2019, 2449;
# preset paper 1474, 1488, 1588, 2115; and of 100 megapixels with a fourth of its prompts 4125. Scenes differ in the
# number of large regions: "full" allows for a pair of 200 megapixels that was reported to take 20.7 GB (preset paper).
MEMORY = {
    "program": 0.6e9,  # what is loaded before any network, and the result
    "pixel": 25.0,  # for each pixel of both photographs
    "full": 25.0,  # the same, more where segment.quality is full
    "tiles": 0.5e9,  # what is kept from one tile to the next, and the cache of blocks (docs/results.md: 2.5 GB in all)
}


def whole(config: Config, sizes: Sequence[Size], own_regions: bool) -> float:
    """Bytes for a pair matched as a whole. own_regions: no network segments."""
    areas = [width * height for width, height in sizes]
    networks = 0.0 if own_regions else max(_regions(config.segment.model, size) for size in sizes)
    points = [_points(name, config.points, size) for name in config.points.methods for size in sizes]
    each = MEMORY["pixel"] + (MEMORY["full"] if config.segment.quality == "full" and not own_regions else 0.0)
    return MEMORY["program"] + max(networks, *points) + each * sum(areas)


def search(method: str, side: int) -> float:
    """Bytes while a point method looks at a view of side x side px."""
    working = METHODS.get(method).info if method in METHODS else None
    return MEMORY["program"] + (working.working_bytes + working.bytes_per_pixel * side**2 if working else 0.0)


def in_tiles(config: Config, sizes: Sequence[Size], held: float, own_regions: bool) -> float:
    """Bytes for a pair matched in tiles, including the `held` bytes that the photographs take all the time."""
    side = config.tiles.size
    views = [(side, side) if width * height > side**2 else (width, height) for width, height in sizes]
    return held + MEMORY["tiles"] + whole(config, views, own_regions)


def refuse_whole(config: Config, sizes: Sequence[Size], own_regions: bool) -> None:
    """`InputError` for a pair that does not fit into the memory budget as a whole."""
    ways = "match it in tiles (--tiles auto), reduce it, or raise --max-memory"
    memory.refuse_above(whole(config, sizes, own_regions), f"a pair of {_text(sizes)} px as a whole", ways)


def refuse_in_tiles(config: Config, sizes: Sequence[Size], held: float, own_regions: bool) -> None:
    """`InputError` for a pair that does not fit into the memory budget even in tiles."""
    what = f"a pair of {_text(sizes)} px in tiles of {config.tiles.size} px"
    ways = "make tiles.size smaller, or raise --max-memory"
    memory.refuse_above(in_tiles(config, sizes, held, own_regions), what, ways)


def _regions(segmenter: str, size: Size) -> float:
    """Bytes for the regions of one photograph."""
    info = SEGMENTERS.get(segmenter).info
    return info.working_bytes + info.bytes_per_pixel * size[0] * size[1]


def _points(method: str, config: PointsConfig, size: Size) -> float:
    """Bytes for the points of one photograph; 0 for a method of the caller's own."""
    if method not in METHODS:
        return 0.0
    known = METHODS.get(method).info
    reduction = 1.0 if known.full_size else min(1.0, config.side(known.longest_side) / max(size))
    return known.working_bytes + known.bytes_per_pixel * size[0] * size[1] * reduction**2


def _text(sizes: Sequence[Size]) -> str:
    return " and ".join(dict.fromkeys(f"{width} x {height}" for width, height in sizes))
