"""The last judge: is a proposed match right, by evidence that did not make it."""

from zpm2.verify.confidence import confidence
from zpm2.verify.evidence import Evidence, gather
from zpm2.verify.judge import judged, same_scene_matches, verified

__all__ = ["Evidence", "confidence", "gather", "judged", "same_scene_matches", "verified"]
