"""Regions followed through many photographs (`zpm2.tracking`)."""

from dataclasses import dataclass

from zpm2.config.fields import number, option, share


@dataclass(frozen=True)
class TracksConfig:
    """`zpm2 tracks`."""

    window: int = number(
        2, "--pairs sequential: photographs after each that it is matched with", low=1, source="a cycle needs two"
    )
    neighbors: int = number(
        4, "--pairs auto: best other photographs that each is matched with", low=1, source="as cloud.neighbors"
    )
    look_side: int = number(
        640, "--pairs auto: longer side at which photographs are compared", unit="px", low=64, source="time"
    )
    look_keypoints: int = number(512, "--pairs auto: of each photograph then", low=8, source="time")
    max_looks: int = number(
        2000, "--pairs auto: pairs that are compared, the nearest by name first", low=1, source="a minute or two"
    )
    min_points: int = number(
        20, "--pairs auto: points that agree on one geometry, from which on a pair is matched", low=8, source="chance"
    )
    same: float = share(
        0.7,
        "IoU from which on outlines of one photograph, found in several pairs, are one region",
        above=True,
        source="as segment.nms_iou",
    )
    extend: bool = option(True, "carry regions into neighbours of their photographs where they were missed")
    min_carried: float = share(
        0.8,
        "confidence from which on a carried outline joins its track",
        source="tried on fountain-P11 (docs/tracks.md)",
    )
    max_carried: int = number(
        100, "regions carried from one photograph to another, those in most photographs first", source="time"
    )
    part_inside: float = share(
        0.8, "of a region inside the place of another, from which on it may be a part of it", source="outlines differ"
    )
    parts_cover: float = share(
        0.7, "of a region's place that its parts cover, from which on it was split", source="outlines differ"
    )
    looked_at: int = number(
        8,
        "photographs that stay in memory with what was found in each alone, the latest used; each takes some 30 MB",
        low=2,
        high=10_000,
        source="pairs of neighbours follow one another",
    )
    on_disk: float = number(
        4.0,
        "for what networks found in other photographs, or in the left one's windows (zpm2 carry), in the output folder "
        "until the end; each takes some 12 MB",
        unit="GB",
        high=1e6,
        source="300 photographs",
    )
