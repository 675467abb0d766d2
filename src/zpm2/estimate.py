"""How much memory a pair takes, told from its size and the configuration before anything is loaded.

The numbers are `config.MEMORY` and `config.POINT_MEMORY`, measured and rounded up. They are of a whole process.
"""

from collections.abc import Sequence

from zpm2 import memory
from zpm2.config import MEMORY, POINT_MEMORY, Config

Size = tuple[int, int]  # (width, height) px


def whole(config: Config, sizes: Sequence[Size], own_regions: bool) -> float:
    """Bytes for a pair matched as a whole. own_regions: no network segments."""
    areas = [width * height for width, height in sizes]
    networks = 0.0 if own_regions else MEMORY[config.segment.model]
    points = [_points(name, config.points.max_size, size) for name in config.points.methods for size in sizes]
    each = MEMORY["pixel"] + (MEMORY["full"] if config.segment.quality == "full" and not own_regions else 0.0)
    return MEMORY["program"] + max(networks, *points) + each * sum(areas)


def in_tiles(config: Config, sizes: Sequence[Size], held: float, own_regions: bool) -> float:
    """Bytes for a pair matched in tiles, of which the photographs take `held` bytes all the time."""
    side = config.tiles.size
    views = [(side, side) if width * height > side**2 else (width, height) for width, height in sizes]
    return held + MEMORY["tiles"] + whole(config, views, own_regions)


def refuse_whole(config: Config, sizes: Sequence[Size], own_regions: bool) -> None:
    """`InputError` for a pair that does not fit into the budget of memory as a whole."""
    ways = "match it in tiles (--tiles auto), reduce it, or raise --max-memory"
    memory.refuse_above(whole(config, sizes, own_regions), f"a pair of {_text(sizes)} px as a whole", ways)


def refuse_in_tiles(config: Config, sizes: Sequence[Size], held: float, own_regions: bool) -> None:
    """`InputError` for a pair that does not fit into the budget of memory in tiles either."""
    what = f"a pair of {_text(sizes)} px in tiles of {config.tiles.size} px"
    ways = "make tiles.size smaller, or raise --max-memory"
    memory.refuse_above(in_tiles(config, sizes, held, own_regions), what, ways)


def _points(method: str, max_size: int, size: Size) -> float:
    """Bytes for the points of one photograph. SIFT looks at it as it is."""
    reduction = 1.0 if method == "sift" else min(1.0, max_size / max(size))
    return POINT_MEMORY.get(method, 0.0) * size[0] * size[1] * reduction**2


def _text(sizes: Sequence[Size]) -> str:
    return " and ".join(dict.fromkeys(f"{width} x {height}" for width, height in sizes))
