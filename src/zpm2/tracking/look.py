"""A quick look at many pairs: how many points of each agree on one geometry."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

from zpm2 import features
from zpm2.config import Config
from zpm2.global_match import initial_geometry, points_with_data
from zpm2.photos.source import open_source, reduced
from zpm2.runtime import Progress
from zpm2.tracking.photographs import Photograph


def agreeing_points(
    photographs: Sequence[Photograph],
    pairs: Sequence[tuple[int, int]],
    config: Config,
    device: str,
    progress: Progress,
) -> list[int]:
    """Of each pair, the points that agree on an epipolar geometry; 0 where they do no better than by chance.

    By the configured point matcher, of reduced photographs (`tracks.look_side`). Detectors see each photograph once.
    """
    progress("look", 0.0)
    few = replace(config.points, max_keypoints=min(config.tracks.look_keypoints, config.points.max_keypoints))
    matcher = features.create(few, device)
    images = []
    for each in photographs:
        with closing(open_source(each.path, "photograph", config.raster)) as source:
            images.append(reduced(source, config.tracks.look_side))
    both = [(images[i], images[j]) for i, j in pairs]
    counts = []
    for k, (points, seen) in enumerate(zip(matcher.match_many(both), both, strict=True)):
        initial = initial_geometry(points_with_data(points, seen), config.global_match, config.seed)
        counts.append(initial.agreeing if initial.supported else 0)
        progress("look", (k + 1) / len(both))
    progress("look", 1.0)
    return counts
