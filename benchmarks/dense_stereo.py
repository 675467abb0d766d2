"""Dense stereo of rectified pairs with known disparity: how much is found, how well, how fast.

    python benchmarks/dense_stereo.py --root DATA [--pairs NAME ...] [--set stereo.method=mc-cnn ...]

DATA/pairs.json lists the pairs (those with a disparity are taken). Searched are the disparities of the truth and 8 px
more at either end. For each pair and each `--variant` (a name and options, "aerial: stereo.method=mc-cnn
stereo.weights=aerial"): share of the pixels with a known truth that have a disparity (density), percent of these that
are wrong by more than 1 and 3 px (bad_1, bad_3), percent of all with a known truth that are right within 1 and 3 px
(right_1, right_3), seconds, and the peak of memory of a process of its own, in MB, without what is loaded before. The
time excludes loading. Prints the table to stderr and JSON (schema zpm2-bench-dense-stereo/1).
"""

import argparse
import multiprocessing
import resource
import sys
import time
from pathlib import Path
from typing import Any

import document
import numpy as np

from zpm2.config import Config
from zpm2.config.parse import with_settings
from zpm2.evaluate.datasets.pair_list import from_json
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.formats.maps import read_disparity
from zpm2.photos.images import read_image
from zpm2.stereo.dense import stereo_matcher

VARIANTS = ("sgbm:", "mc-cnn: stereo.method=mc-cnn", "mc-cnn aerial: stereo.method=mc-cnn stereo.weights=aerial")
COLUMNS = ("pair", "method", "density", "bad_1", "bad_3", "right_1", "right_3", "s", "MB")
MARGIN = 8  # px
