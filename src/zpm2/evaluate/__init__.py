"""How good matches are: data sets, ground truth, metrics."""

from zpm2.evaluate.ground_truth import CoVisible, Overlap, center_pairs, covisible, mutual_best, overlap
from zpm2.evaluate.metrics import Scores, score, score_centers, scores
from zpm2.evaluate.pairs import (
    Dataset,
    DepthTruth,
    DisparityTruth,
    EvalPair,
    HomographyTruth,
    PoseTruth,
    Truth,
)
from zpm2.evaluate.pose_error import pose_auc, pose_error
from zpm2.evaluate.run import Evaluation

__all__ = [
    "CoVisible",
    "Dataset",
    "DepthTruth",
    "DisparityTruth",
    "EvalPair",
    "Evaluation",
    "HomographyTruth",
    "Overlap",
    "PoseTruth",
    "Scores",
    "Truth",
    "center_pairs",
    "covisible",
    "mutual_best",
    "overlap",
    "pose_auc",
    "pose_error",
    "score",
    "score_centers",
    "scores",
]
