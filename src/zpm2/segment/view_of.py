"""A photograph as a segmenter sees it, encoded once while it is kept."""

from zpm2.model import Image
from zpm2.photos.kept import KeptPhotos
from zpm2.segment.protocol import PromptedSegmenter, PromptedView


def view_of(segmenter: PromptedSegmenter, image: Image, kept: KeptPhotos) -> PromptedView:
    """The photograph, encoded."""
    return kept.found(image, ("view", id(segmenter)), lambda: segmenter.view(image))
