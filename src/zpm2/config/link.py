"""Polygons of two layers without photographs (`zpm2.linking`)."""

from dataclasses import dataclass

from zpm2.config.fields import number, share

ROOFS = "measured on roof prints of two satellite images, docs/link.md"


@dataclass(frozen=True)
class LinkConfig:
    """`zpm2 link`."""

    reach: float = number(
        25.0, "shift between the layers that is looked for first", unit="m", above=True, high=1e5, source="the usual"
    )
    max_reach: float = number(
        2000.0,
        "shift up to which it is looked for, five times farther each time",
        unit="m",
        above=True,
        high=1e5,
        source="a turn of 5 degrees about a place 20 km away",
    )
    max_turn: float = number(6.0, "turn between the layers", unit="degrees", high=45.0, source="5 and a margin")
    tolerance: float = number(
        3.0, "up to which two pairs of polygons agree on a shift", unit="m", above=True, high=1000.0, source=ROOFS
    )
    seed_polygons: int = number(
        200, "left polygons around a place that vote for a shift and a turn", low=5, high=10_000, source="time grows"
    )
    seeds: int = number(5, "places that are tried", low=1, high=100, source="time grows")
    max_pairs: int = number(
        300_000, "pairs of polygons that vote at one place", low=1000, high=100_000_000, source="time grows"
    )
    min_area_ratio: float = share(
        0.5, "smaller by larger area of two polygons, from which on they vote", above=True, source=ROOFS
    )
    chance: float = share(
        0.001, "chance that unrelated layers have a vote as high, up to which it counts", source="one of 1000"
    )
    max_second: float = share(
        0.8, "of the best vote that another shift and turn may have", above=True, source="houses in rows repeat"
    )
    gathered: float = share(
        0.2,
        "of the right centres within 2 tolerances of places that lie within half a tolerance, from which on a map "
        "holds",
        source="1/16 by chance, 0.6 on roof prints",
    )
    local_pairs: int = number(
        20, "pairs around a polygon whose median residual moves it", low=1, high=1000, source=ROOFS
    )
    local_radius: float = number(
        200.0, "within which they lie", unit="m", above=True, high=1e5, source="slow variation only"
    )
    max_distance: float = number(
        15.0, "between the centres of linked polygons, once moved", unit="m", above=True, high=1000.0, source=ROOFS
    )
    min_sigma: float = number(
        0.05, "least standard deviation of a centre along each axis", unit="m", above=True, high=100.0, source="drawing"
    )
    same_shape: float = share(
        0.78, "IoU of two outlines laid centre on centre that speaks neither for nor against a link", source=ROOFS
    )
    by_shape: float = number(16.0, "weight of that IoU", unit="log-odds", high=1000.0, source=ROOFS)
    least_by_shape: float = number(
        1.6, "log-odds that another shape takes from a link at most", high=100.0, source=ROOFS
    )
    overlapping: float = share(
        0.05,
        "of the polygons around that chance lays onto a place of another thing",
        above=True,
        source="polygons of a layer hardly overlap",
    )
    prior: float = share(0.75, "of the polygons of the common ground that have a partner", above=True, source=ROOFS)
    min_confidence: float = share(
        0.5,
        "probability of a pair, against neither having a partner, above which it may be a link",
        high=0.999,
        above=True,
        source="as likely as not",
    )
    part: float = share(0.7, "of a polygon inside another one, from which on it is a part of it", source="a majority")
    parts: float = share(0.5, "of a polygon that its parts cover, from which on they are its parts", source="half")
    outside: float = number(
        150.0,
        "to the nearest polygon of the other layer, beyond which a polygon is outside of it",
        unit="m",
        source="some streets",
    )
