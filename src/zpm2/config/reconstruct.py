"""Cameras and a surface from photographs (`zpm2 reconstruct`)."""

from dataclasses import dataclass

from zpm2.config.fields import number, option, share


@dataclass(frozen=True)
class ReconstructConfig:
    """Structure from motion, undistortion, fusion and Poisson meshing by COLMAP; depth maps between."""

    max_size: int = number(
        1600,
        "the longer side of the images that depth is computed on",
        unit="px",
        low=100,
        high=100_000,
        source="as points.max_size",
    )
    neighbors: int = number(
        3,
        "views that the depth of each view is computed from",
        low=1,
        high=1000,
        source="time; two of three must agree",
    )
    ordered: bool = option(False, "the photographs are a sequence: each is matched with the next ones only")
    min_points: int = number(10, "sparse points of a usable model", source="fewer are no model")
    min_common_points: int = number(
        20, "sparse points that two neighbours share", low=1, source="fewer do not tell the range of depths"
    )
    min_angle: float = number(
        2.0,
        "between lines of sight of neighbours; less is imprecise",
        unit="degrees",
        high=180.0,
        source="depth is off by thirty times the error across",
    )
    max_angle: float = number(35.0, "the same; beyond, views do not look alike", unit="degrees", high=180.0)
    good_angle: float = number(8.0, "from which on a wider one is no better", unit="degrees", above=True, high=180.0)
    range_margin: float = number(
        0.15,
        "as `stereo.range_margin`, for disparities that sparse points predict",
        source="wider than stereo.range_margin: sparse points are few",
    )
    depth_agreement: float = share(0.01, "of the depth, by which maps of different neighbours that agree may differ")
    min_agreeing: int = number(
        2,
        "maps that agree on a depth, where there are three or more",
        low=1,
        high=1000,
        source="one map alone is not checked",
    )
    normal_smoothing: float = number(
        2.0,
        "standard deviation of the mean of normals",
        unit="px",
        above=True,
        source="differences of neighbours are noise",
    )
    min_normal: float = share(0.1, "length of a mean of unit normals, below which they point anywhere")
    fusion_views: int = number(
        3,
        "views that agree on a point of the fused cloud; all, where there are fewer",
        low=1,
        high=1000,
        source="COLMAP: 5; of few photographs fewer show a point",
    )
    fusion_angle: float = number(
        40.0,
        "between their normals, where depth is not PatchMatch's: from differences of depth they are noisier",
        unit="degrees",
        high=180.0,
        source="COLMAP: 10, for normals of PatchMatch",
    )
    min_fused_points: int = number(100, "fused points that a surface is made of", low=1, source="fewer are no surface")
    poisson_depth: int = number(
        11, "of the octree", low=1, high=20, source="Kazhdan and Hoppe 2013; COLMAP's default is 13"
    )
    trim: float = number(
        8.0,
        "octree depth of the sampling below which the surface is cut away",
        high=20.0,
        source="COLMAP's default is 10; lower keeps what few points show",
    )
