"""A photograph as a segmenter sees it, encoded once while it is kept."""

from zpm2.model import Image
from zpm2.photos.kept import Form, KeptPhotos
from zpm2.segment.checked_view import views_of, written_of
from zpm2.segment.protocol import PromptedSegmenter, PromptedView, WritableSegmenter


def view_of(segmenter: PromptedSegmenter, image: Image, kept: KeptPhotos) -> PromptedView:
    """The photograph, encoded."""
    form = None
    if isinstance(segmenter, WritableSegmenter):
        form = Form(
            lambda view: written_of(segmenter, view),
            lambda arrays: views_of(segmenter, [image], lambda: [segmenter.view_of_written(image, arrays)])[0],
        )
    return kept.found(
        image, ("view", id(segmenter)), lambda: views_of(segmenter, [image], lambda: [segmenter.view(image)])[0], form
    )
