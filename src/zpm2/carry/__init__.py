"""Regions of one photograph in another: by homologous points, by likeness, and by asking the segmenter there."""

from zpm2.carry.outcome import Outcome
from zpm2.carry.result import CarryResult
from zpm2.carry.run import Regions, carry, opened_regions

__all__ = ["CarryResult", "Outcome", "Regions", "carry", "opened_regions"]
