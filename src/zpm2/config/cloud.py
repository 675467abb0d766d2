"""Polygons lifted onto a surface (paper 3.5.2)."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option, share


@dataclass(frozen=True)
class CloudConfig:
    """Polygons lifted onto a surface (paper 3.5.2). The paper prints none of these numbers."""

    diffusion: Literal["scale", "surface"] = option(
        "scale", "one scale for all of it, or its part on one surface", source="paper 3.5.2; surface: docs/cloud.md"
    )
    step: float = number(
        2.0,
        "delta: samples of a boundary are no farther apart",
        unit="px",
        above=True,
        source="the accuracy of an outline",
    )
    max_samples: int = number(
        10_000,
        "of a polygon's area and boundary where it is tried, about; larger polygons are sampled farther apart",
        low=1,
        source="time",
    )
    min_scale: float = share(
        0.4,
        "s_min: a polygon that must shrink further, to less than its square of area, is rejected",
        above=True,
        source="less than a sixth of its area is another thing",
    )
    halvings: int = number(
        6, "of the interval of scales, from s_min to 1", high=60, source="to a hundredth of the size"
    )
    max_edge: float = number(
        6.0,
        "tau, a longer edge between samples, per px, leads to another surface",
        unit="medians",
        source="a surface seen at 80 degrees has edges as long",
    )
    max_fold: float = number(
        100.0,
        "between normals of neighbouring samples, beyond which the surface is folded",
        unit="degrees",
        source="more than a right angle, the corner of a house",
    )
    max_size: float = number(
        20.0,
        "times the size that it would have facing the camera; roads are seen at a small angle",
        source="a surface seen at 87 degrees",
    )
    cut_width: float = number(
        1.0,
        "diffusion=surface: bays and capes of the cut that are narrower go",
        unit="steps",
        above=True,
        source="what is thinner than a sample is not known",
    )
    cut_radius: float = number(
        1.5,
        "diffusion=surface: of the discs taken away where a boundary runs across an edge",
        unit="steps",
        source="takes one sample to either side",
    )
    cut_rounds: int = number(
        4,
        "diffusion=surface: such discs are taken away, at most",
        unit="times",
        high=1000,
        source="time",
    )
    cut_simplify: float = number(
        0.25,
        "diffusion=surface: tolerance by which an outline is simplified after a cut",
        unit="steps",
        source="the steps of the grid go, the outline stays",
    )
    cut_neighborhood: float = number(
        4.0,
        "diffusion=surface: from a cut, within which thin pieces go",
        unit="cut_width",
        source="thin parts of the polygon elsewhere stay",
    )
    min_part_hole: float = share(
        0.02,
        "diffusion=surface: of the area; smaller holes of the part are closed",
        source="holes of noise are smaller",
    )
    max_missed: float = share(
        0.05,
        "samples of a boundary that may fall through the surface",
        source="small holes of a mesh are no border of the surface",
    )
    max_path: float = number(
        4.0, "times the straight distance: a longer path between samples went around something", low=1.0
    )
    max_crossings: int = number(
        20_000,
        "edges of the mesh that a path between samples may cross",
        low=1,
        source="time; a path so long went astray",
    )
    min_overlap: float = share(
        0.5,
        "IoU of a lifted polygon, seen from the other camera, with its partner there",
        source="as a match is scored",
    )
    max_distance: float = number(
        0.25,
        "distance between the boundaries that both views lift",
        unit="sqrt(area)",
        source="half of the radius of a disc of that size, about",
    )
    fill: float = number(
        0.02,
        "of the mesh's extent: holes up to this wide are filled",
        source="holes where a camera saw nothing, not doors and windows",
    )
    max_hole_bend: float = number(
        0.15,
        "distance of a rim from its plane, times its width, beyond which it stays open",
        source="around a bent rim a smooth filling is a guess",
    )
    max_hole_edges: int = number(1000, "of a rim; one with more stays open", low=3, source="time")
    max_hole_support: int = number(
        400, "points of the rim and next to it that shape a filling, about", low=3, source="time grows with the cube"
    )
    neighbors: int = number(
        2, "views that each view is matched with", low=1, high=10_000, source="time; two see what one does not"
    )
    neighbor_rays: int = number(
        1500, "of each view, to see what it shares with others", low=1, source="a share to one in a hundred"
    )
    max_neighbor_angle: float = number(
        60.0, "between lines of sight, from which on regions do not look alike", unit="degrees", above=True, high=180.0
    )
    visible: float = share(
        1e-3, "of its distance: a point is seen that a ray meets this near", source="the accuracy of a mesh"
    )
    same: float = share(
        0.75,
        "IoU from which on two regions of an image, or two patches, are one",
        source="above segment.nms_iou, below which both stay",
    )
    nested: float = share(
        0.9,
        "of a patch's area that lies in a larger one, from which on it is a part of it",
        source="outlines of two masks differ by a px or two",
    )
    coverage_rays: int = number(
        20_000, "of each view, to measure what the patches cover", low=1, source="a share to one in two hundred"
    )
    tear: float = number(
        1.0,
        "disparity between neighbouring pixels, beyond which the surface of a stereo pair is torn",
        unit="px",
        source="neighbours on one surface differ by less, unless it is seen at a very small angle",
    )
    max_faces: int = number(
        4_000_000, "of the surface of a stereo pair; larger maps are thinned", low=2, source="memory"
    )
