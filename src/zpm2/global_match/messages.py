"""Warnings and notes about the geometry of a pair."""

from zpm2.config import GlobalConfig
from zpm2.errors import Failed
from zpm2.global_match.chance import MIRRORED
from zpm2.global_match.initial import InitialGeometry
from zpm2.global_match.pyramid import PyramidLocations
from zpm2.model.messages import Note


def geometry_warnings(initial: InitialGeometry) -> list[str]:
    """Which geometry is missing, and why the photographs may not belong together."""
    found = []
    for name, estimated in (("fundamental matrix", initial.fundamental), ("homography", initial.homography)):
        if isinstance(estimated, Failed):
            found.append(f"no {name}: {estimated.reason}")
    if not initial.supported:
        found.append(
            "the photographs may not show the same scene: "
            f"{initial.agreeing} of {len(initial.points)} homologous points agree on one geometry, which may be chance"
        )
    if initial.mirrored:
        found.append(MIRRORED)
    return found


def location_notes(locations: PyramidLocations, config: GlobalConfig) -> list[str]:
    """How many polygons the pyramid could not confirm."""
    predicted = ~locations.found
    if config.search == "fixed" or not predicted.any():
        return []
    count, outside = int(predicted.sum()), int((predicted & locations.outside).sum())
    return [
        Note(
            f"{count} of {len(predicted)} left polygons stay where the geometry predicts them: {outside} beyond the "
            f"right image, {count - outside} without texture that correlates"
        )
    ]
