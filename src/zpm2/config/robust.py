"""The robust estimator of fundamental matrices, homographies and essential matrices."""

from dataclasses import dataclass

from zpm2.config.fields import number, share


@dataclass(frozen=True)
class MagsacConfig:
    """MAGSAC++ (Barath et al., CVPR 2020; OpenCV's USAC). Searches longer than OpenCV's defaults do: where photographs
    differ much, most points are wrong."""

    confidence: float = share(
        0.9999, "chance that one of the samples held true points only, at which the search ends", source="OpenCV: 0.99"
    )
    max_iterations: int = number(10_000, "samples at most", low=1, high=1_000_000, source="OpenCV: 5000")
    local_iterations: int = number(
        10, "of the local optimisation of a model better than all before", low=1, high=1000, source="OpenCV: 5"
    )
    local_samples: int = number(
        50, "points of a sample of the local optimisation", low=8, high=10_000, source="OpenCV: 14"
    )
    polish_iterations: int = number(
        3, "of the last fit, to all points by their weights", high=1000, source="OpenCV's own"
    )
    min_fundamental: int = number(
        8, "points, and inliers, of a fundamental matrix", low=8, source="any seven points fit one exactly"
    )
    min_homography: int = number(
        6, "points, and inliers, of a homography", low=5, source="any four fit one exactly; two more must agree"
    )
