"""The pair of a pose as a rectified stereo pair (`stereo.rectify`)."""

from collections.abc import Sequence

from zpm2.config import StereoConfig
from zpm2.errors import Failed
from zpm2.model import Image, Polygon
from zpm2.pose.result import PoseResult
from zpm2.stereo import rectify as stereo
from zpm2.stereo.rectify import RectifiedPair


def rectify(
    result: PoseResult,
    images: tuple[Image, Image],
    polygons: tuple[Sequence[Polygon], Sequence[Polygon]],
    config: StereoConfig | None = None,
) -> RectifiedPair | Failed:
    """The rectified pair; it shows all points that agree with the pose.

    images: the originals. polygons: the matched polygons of each image. config: that of the run; None for the defaults.
    `Failed` without a pose or a translation, and if a camera moved along its own line of sight.
    """
    if isinstance(result.pose, Failed):
        return Failed(f"without a pose there is no rectified pair: {result.pose}")
    if result.translation is None:
        return Failed("a camera that only turned gives no rectified pair")
    assert not isinstance(result.cameras, Failed)
    points = result.points.points.left[result.inliers], result.points.points.right[result.inliers]
    motion = result.pose.rotation, result.translation
    return stereo.rectify(result.cameras, motion, points, images, polygons, config or StereoConfig())
