"""The numbers that the paper prints (Li and Peng, Z(PM)², tables of section 4). Published, not measured here."""

from typing import NamedTuple


class Matching(NamedTuple):
    """A row of "Evaluation on SceneFlow, KITTI, and ScanNet datasets" (Table 1)."""

    dataset: str
    method: str
    mas40: float  # %
    mas50: float  # %
    mas80: float  # %
    matches: float  # a pair
    seconds: float  # a pair, one NVIDIA L40


class Discrete(NamedTuple):
    """A row of "Geometric precision metrics and coverage performance"."""

    dataset: str
    recall: float  # %
    precision: float  # %
    f1: float
    acr: float  # %


class SamSize(NamedTuple):
    """A row of "Impact of SAM segmentation quality with different parameter sizes"."""

    model: str
    recall: float  # %
    precision: float  # %
    f1: float


class LargeFormat(NamedTuple):
    """A row of "Evaluation on ISPRS dataset under different pyramid levels"."""

    method: str
    resolution: str
    seconds: float
    acr: float  # %
    matches: float


class Ablation(NamedTuple):
    """A row of "Ablation study on the SceneFlow dataset"."""

    method: str
    acr: float  # %
    matches: float
    seconds: float


class Pose(NamedTuple):
    """A row of "Camera pose estimation on ScanNet1500"."""

    method: str
    auc5: float
    auc10: float
    auc20: float


MATCHING = (
    Matching("SceneFlow", "Shape Context", 43.15, 43.26, 43.66, 60.37, 247.35),
    Matching("SceneFlow", "IDSC", 43.24, 43.35, 43.75, 60.37, 902.14),
    Matching("SceneFlow", "MESA", 36.23, 36.20, 35.96, 12.05, 47.52),
    Matching("SceneFlow", "SGAM", 40.31, 40.29, 40.13, 16.00, 11.08),
    Matching("SceneFlow", "MASA", 29.19, 30.37, 30.06, 3.04, 2.18),
    Matching("SceneFlow", "Z(PM)² + SuperPoint + LightGlue", 68.60, 68.57, 68.51, 27.50, 3.27),
    Matching("SceneFlow", "Z(PM)² + LoFTR", 44.95, 44.91, 44.74, 20.59, 16.94),
    Matching("KITTI", "Shape Context", 38.25, 38.26, 38.62, 55.37, 215.35),
    Matching("KITTI", "IDSC", 38.31, 38.37, 38.71, 55.37, 792.14),
    Matching("KITTI", "MESA", 22.15, 22.14, 21.85, 24.26, 103.20),
    Matching("KITTI", "SGAM", 26.40, 26.35, 26.17, 19.14, 12.83),
    Matching("KITTI", "MASA", 18.46, 18.71, 18.80, 2.10, 1.42),
    Matching("KITTI", "Z(PM)² + SuperPoint + LightGlue", 58.20, 58.15, 58.04, 30.28, 1.92),
    Matching("KITTI", "Z(PM)² + LoFTR", 41.26, 41.20, 41.00, 29.55, 7.77),
    Matching("ScanNet", "Shape Context", 14.52, 14.91, 15.70, 40.96, 174.63),
    Matching("ScanNet", "IDSC", 14.66, 15.06, 15.85, 40.96, 540.98),
    Matching("ScanNet", "MESA", 13.52, 13.50, 13.63, 6.22, 25.41),
    Matching("ScanNet", "SGAM", 16.94, 16.92, 17.00, 11.23, 7.08),
    Matching("ScanNet", "MASA", 14.50, 14.13, 14.66, 2.03, 1.20),
    Matching("ScanNet", "Z(PM)² + SuperPoint + LightGlue", 17.39, 17.41, 17.59, 5.01, 2.48),
    Matching("ScanNet", "Z(PM)² + LoFTR", 21.25, 21.50, 21.05, 6.32, 1.42),
)

DISCRETE = (
    Discrete("SceneFlow", 72.67, 87.50, 0.79, 89.34),
    Discrete("ScanNet", 46.12, 61.84, 0.53, 83.28),
    Discrete("KITTI", 70.92, 82.36, 0.76, 81.26),
)

SAM_SIZES = (
    SamSize("vit_h", 72.72, 87.15, 0.79),
    SamSize("vit_l", 57.11, 78.40, 0.66),
    SamSize("vit_b", 59.67, 82.60, 0.69),
)

LARGE_FORMAT = (
    LargeFormat("Z(PM)² (full)", "5750 x 3750", 10.49, 21.92, 17.10),
    LargeFormat("Z(PM)² (L = 2)", "5750 x 3750", 10.70, 21.92, 17.10),
    LargeFormat("fixed range", "5750 x 3750", 15.66, 21.92, 17.10),
    LargeFormat("Z(PM)² (full)", "11500 x 7500", 18.95, 23.15, 10.7),
    LargeFormat("Z(PM)² (L = 2)", "11500 x 7500", 18.96, 23.15, 10.7),
    LargeFormat("fixed range", "11500 x 7500", 24.86, 23.15, 10.7),
)

ABLATION = (
    Ablation("Z(PM)²", 89.02, 42.22, 3.60),
    Ablation("w/o pyramid", 76.94, 37.94, 3.02),
    Ablation("w/o LoJoGM", 14.21, 12.93, 3.33),
    Ablation("w/o LoJoGM and pyramid", 9.56, 10.44, 2.16),
)

POSE = (
    Pose("SP + SGMNet", 15.4, 32.1, 48.3),
    Pose("SiLK", 18.0, 34.4, 50.4),
    Pose("LoFTR", 22.1, 40.8, 57.6),
    Pose("SEEM + SGAM + LoFTR", 23.4, 41.8, 58.7),
    Pose("MESA + LoFTR", 22.9, 41.8, 58.4),
    Pose("Z(PM)²", 23.89, 43.48, 60.74),
)
