"""Regions followed through many photographs: the matches of pairs, joined to tracks.

The function has the name `zpm2.tracks`, so this room cannot: a module of that name would hide it.
"""

from zpm2.tracking.events import Event
from zpm2.tracking.photographs import Photograph
from zpm2.tracking.result import PairSummary, RegionTrack, SeenRegion, TracksResult
from zpm2.tracking.run import tracks

__all__ = ["Event", "PairSummary", "Photograph", "RegionTrack", "SeenRegion", "TracksResult", "tracks"]
