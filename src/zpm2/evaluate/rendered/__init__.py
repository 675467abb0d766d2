"""A scene rendered from code, for `zpm2 demo`: a camera pair with exact truth, and the score of matches against it."""

from zpm2.evaluate.rendered.scene import Scene, render_scene
from zpm2.evaluate.rendered.score import Score, score

__all__ = ["Scene", "Score", "render_scene", "score"]
