"""Photographs that are large, georeferenced, or of many bands."""

from dataclasses import dataclass, field
from typing import Literal

from zpm2.config.fields import number, option, share
from zpm2.errors import ConfigError


def _bands(name: str, value: tuple[int, ...]) -> None:
    if len(value) not in (0, 1, 3) or min(value, default=1) < 1:
        raise ConfigError(f"{name} are one or three band numbers from 1 on, got {','.join(map(str, value))}")


def _gsd(name: str, value: tuple[float, ...]) -> None:
    if len(value) > 2 or min(value, default=1) <= 0:
        raise ConfigError(f"{name} is one number of m per px above 0, or two (left, right)")


@dataclass(frozen=True)
class StretchConfig:
    """Photographs of more than 8 bit: which values become 0 and 255, and which mean no data without saying so."""

    low_percentile: float = number(
        0.5,
        "of the values; it becomes 0",
        unit="%",
        high=100,
        source="measured on 16-bit satellite images: 99 % of the pixels lie in a sixth of the range of all",
    )
    high_percentile: float = number(
        99.5, "of the values; it becomes 255", unit="%", high=100, source="as low_percentile"
    )
    sample_px: int = number(
        4_000_000,
        "of a photograph that are looked at for its range of brightness, about",
        unit="px",
        low=1,
        source="measured: the percentiles of 100 million px to a grey level, in 0.1 s instead of 6",
    )
    min_range: float = share(
        0.25,
        "of the full range; a photograph that uses less is stretched",
        source="two of its bits, or more, are unused",
    )
    fill_share: float = share(
        0.05,
        "of the pixels that have one value, from which on it is no data",
        source="measured: 1.1 % have the commonest value of 16-bit satellite images",
    )
    fill_border_share: float = share(
        0.5,
        "the same, of the pixels along the border",
        source="measured: 1.7 % there",
    )
    picture_share: float = share(
        0.99,
        "of one value, from which on it is the picture itself",
        source="beyond, there is nothing left to match; masks of one object have up to 97 %",
    )
    noticed_share: float = share(
        0.005,
        "of one value, below which it is not looked at",
        source="fewer pixels than a frame one pixel wide around 800 x 800",
    )
    far_share: float = share(
        0.25,
        "of the range of all other values; a value farther away may mean no data: a warning",
        source="measured: 0.22 at most in 106 photographs, where a glint is far from all other values",
    )


@dataclass(frozen=True)
class RasterConfig:
    """Georeferenced and many-band photographs (extra `geo`)."""

    bands: tuple[int, ...] = option(
        (), "one (grey) or three (R, G, B), from 1 on; none: those that the file says are colours", check=_bands
    )
    gsd: tuple[float, ...] = option(
        (), "on the ground per px, one or left and right; none: what the files say", unit="m", check=_gsd
    )
    min_area_m2: float = number(
        0.0, "on the ground; smaller polygons are left out, `segment.min_area` counts too", unit="m^2"
    )
    large_px: int = number(
        16_000_000,
        "pixels; a photograph with more is read by windows, and matched in tiles where `tiles.mode` is auto",
        source="the memory that whole photographs take, docs/large-format.md",
    )

    stretch: StretchConfig = field(default_factory=StretchConfig)


@dataclass(frozen=True)
class PartnerConfig:
    """Which window of the right photograph shows what a left tile shows."""

    neighbors: int = number(
        8,
        "of a point; it is kept if enough of them move with it",
        low=2,
        high=1000,
        source="few enough to stay near, enough for a majority",
    )
    min_coherent: float = share(0.5, "of these neighbours, from which on they are enough", source="a majority")
    max_apart: float = number(
        2.0,
        "of neighbours on the right, up to which they move with a point",
        unit="times their scaled left distance",
        source="relief and perspective stretch distances by less",
    )
    max_spread: float = number(
        2.0,
        "of the distances of neighbours, in the scale that the extents of all points lead to",
        low=1,
        source="wrong points make the median of distances too large",
    )
    min_points: int = number(
        12, "for the affine map of a window", low=3, source="four times the three that fix an affine map"
    )
    enough_points: int = number(
        60, "in a window; where it has fewer, the nearest ones beside it help", low=3, source="outweigh wrong ones"
    )
    min_agreeing: float = share(0.3, "of these points, with the affine map")
    noise: float = share(
        0.02,
        "of a window's side, by which relief moves points from an affine map",
    )
    max_scale: float = number(
        8.0,
        "right px per left px, or the reverse, of a map that is believed",
        low=1,
    )
    same_scale: float = number(
        1.1,
        "right px per left px up to which both tiles have the same scale",
        low=1,
        source="learned points stand 1.5",
    )
    min_shared: float = share(
        0.02, "of a mapped window that must lie in the right photograph", source="less shows no whole region"
    )
    outliers: float = share(
        0.02,
        "of the right partners of a window's points at each end, that do not widen it",
        high=0.4,
        source="a few wrong points must not widen it",
    )
    max_relief: float = number(
        0.25,
        "by which they widen the mapped window on each side at most",
        unit="of its side",
        source="what stands higher is rare",
    )
    georeference_margin: float = number(
        0.5,
        "around a window that only georeferences place",
        unit="of its side",
        source="georeferences may be off by a part of a tile",
    )
    max_first_share: float = share(
        0.25,
        "of the right photograph, up to which the first tile is compared with that part alone",
    )
    min_side: int = number(
        64,
        "of the right view; a smaller one is no partner",
        unit="px of the view",
        low=1,
        source="SAM sees it 16 times enlarged",
    )
    side_steps: int = number(
        4,
        "in a tile's side: the sides of right views are multiples of one",
        low=1,
        high=64,
        source="networks prepare for each size of image: few sizes cost less",
    )


@dataclass(frozen=True)
class CellsConfig:
    """The geometry of a large scene, cell by cell."""

    polygons_across: int = number(
        4,
        "of the largest size, along the side of a cell",
        low=1,
        high=1000,
        source="a cell must hold a polygon and what is around it",
    )
    min_points: int = number(
        100,
        "inside of half a cell around it; where there are fewer, the nearest ones",
        low=2,
        source="F and H with wrong points among them",
    )
    max_distance: float = number(
        1.5,
        "of these nearest ones from its middle",
        unit="cells",
        above=True,
        source="farther ones tell nothing about this place",
    )
    max_points: int = number(2000, "that F and H are estimated from", low=8, source="time; more say the same")
    affine_noise: float = share(
        0.02,
        "threshold of the affine map, where no homography holds, of the extent of the points",
        source="as tiles.partner.noise",
    )
    neighbors: int = number(
        8, "of a point, whose motion predicts its own", low=1, high=1000, source="as tiles.partner.neighbors"
    )
    predicted: float = share(
        0.9,
        "of the points, that lie within the uncertainty of their predicted places",
        source="one in ten may be wrong",
    )


@dataclass(frozen=True)
class BlocksConfig:
    """Matching of the stitched regions, block by block."""

    margin: int = number(
        64,
        "around the polygons of a block, for the search windows",
        unit="px of the block",
        source="more than tau and half of phi",
    )
    max_size_ratio: float = number(
        4.0,
        "of two polygons' longer sides that are compared",
        low=1,
        source="of like shapes, the IoU is at most a sixteenth",
    )
    max_window: float = number(
        1.5, "of the right photograph, for a block", unit="sides of a cell", above=True, source="memory"
    )


@dataclass(frozen=True)
class StitchConfig:
    """Regions of overlapping tiles as the regions of one photograph."""

    border: float = share(
        1.5 / 256, "of a tile's longer side: a region so near to a border is cut by it", source="1.5 px of SAM's masks"
    )
    min_border: float = number(2.0, "the same at least", unit="px", source="the width of an outline")
    trim: float = number(
        4.0,
        "rim of a tile where the neighbour's outline is taken",
        unit="borders",
        source="masks are uncertain near a border",
    )
    min_agreement: float = share(
        0.6,
        "IoU of what two tiles show of one region",
        source="between a scored match (0.5) and a duplicate (segment.nms_iou, 0.7)",
    )
    min_trimmed: float = share(
        0.9,
        "of a united region that must be left without the rims, else they stay",
        source="a thin region is mostly rim",
    )
    min_continued: float = share(
        0.8,
        "of a region along a border that the neighbours must show",
    )


@dataclass(frozen=True)
class TilesConfig:
    """Large photographs, seen in overlapping tiles of several scales."""

    mode: Literal["off", "on", "auto"] = option(
        "off", "auto: where a photograph has more than `raster.large_px`, or is thin, or memory is short"
    )
    size: int = number(
        2048,
        "side of the finest tiles; those of each level above are `step` times as wide",
        unit="px",
        low=256,
        high=32_768,
        source="twice the 1024 px that SAM sees: half of it finds more, in four times the time, docs/large-format.md",
    )
    overlap: float = share(
        0.125,
        "of a tile's side that neighbouring tiles have in common at least",
        high=0.5,
        source="a region of half that width is whole in one of both",
    )
    step: int = number(
        3,
        "width of a level's tiles, in tiles of the next finer level",
        low=2,
        high=64,
        source="as the pyramid, global_match.factor",
    )
    min_tiles: float = number(
        1.25,
        "along the photograph's longer side; a level with fewer is left out",
        low=1,
        source="a level that is hardly finer finds the same",
    )
    outside: bool = option(True, "also segment what only one of the photographs shows")
    min_unseen: float = share(
        0.25,
        "of a right tile that no left tile led to, from which it is segmented alone",
        source="the overlaps on both sides show as much",
    )
    cover_cells: int = number(
        32,
        "along each side of a tile, by which the share that others cover is counted",
        low=1,
        high=1000,
        source="to a thousandth of a tile",
    )
    min_data: float = share(0.01, "of a tile that must show something", source="time")
    min_turn: float = number(
        20.0,
        "smaller turns between the photographs are left to the point matcher",
        unit="degrees",
        high=180,
        source="learned points stand about as much",
    )
    min_region: float = number(
        100.0,
        "smallest region of a tile, unless `segment.min_area` is smaller",
        unit="px^2 of the tile as it is seen",
        source="as segment.min_area",
    )
    overview: int = number(
        2400,
        "longer side of the pixels that a result keeps",
        unit="px",
        low=64,
        source="as wide as the pictures of a result",
    )
    merge_px: float = number(
        2.0,
        "matched points of two tiles that are closer in both photographs are one",
        unit="px",
        source="as points.retry.merge_px",
    )
    coarse_distance: float = number(
        0.125,
        "from the finer points, within which coarser ones are left out",
        unit="sides of a tile",
        source="as tiles.overlap",
    )
    max_points: int = number(
        10_000, "that F and H of the whole pair are estimated from", low=8, source="time; more say the same"
    )
    partner: PartnerConfig = field(default_factory=PartnerConfig)
    cells: CellsConfig = field(default_factory=CellsConfig)
    blocks: BlocksConfig = field(default_factory=BlocksConfig)
    stitch: StitchConfig = field(default_factory=StitchConfig)
