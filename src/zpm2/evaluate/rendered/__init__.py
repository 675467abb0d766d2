"""A scene rendered from code, for `zpm2 demo`: a camera pair with exact truth, and the score of matches against it."""

from zpm2.evaluate.rendered.files import NAMES, save_scene
from zpm2.evaluate.rendered.scene import RenderedScene, render_scene
from zpm2.evaluate.rendered.score import DisparityScore, score_on_disparity

__all__ = ["NAMES", "DisparityScore", "RenderedScene", "render_scene", "save_scene", "score_on_disparity"]
