"""A scene rendered from code, for `zpm2 demo`: a camera pair with exact truth, and the score of matches against it."""

from zpm2.evaluate.rendered.files import NAMES, save_scene
from zpm2.evaluate.rendered.scene import Scene, render_scene
from zpm2.evaluate.rendered.score import Score, score

__all__ = ["NAMES", "Scene", "Score", "render_scene", "save_scene", "score"]
