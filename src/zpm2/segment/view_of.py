"""A photograph as a segmenter sees it, encoded once while it is kept."""

from zpm2.model import Image
from zpm2.photos.kept import Form, KeptPhotos
from zpm2.segment.protocol import PromptedSegmenter, PromptedView, WritableSegmenter


def view_of(segmenter: PromptedSegmenter, image: Image, kept: KeptPhotos) -> PromptedView:
    """The photograph, encoded."""
    form = None
    if isinstance(segmenter, WritableSegmenter):
        form = Form(segmenter.written, lambda arrays: segmenter.view_of_written(image, arrays))
    return kept.found(image, ("view", id(segmenter)), lambda: segmenter.view(image), form)
