"""What zpm2 expects of a segmenter, a point matcher, a data set or a format, as checks that its author runs.

    python -m zpm2.contract package.module:Class

Each kind has a list of checks (`segmenters.CHECKS`, `points.CHECKS`, `datasets.CHECKS`, `formats.CHECKS`), which the
tests of the built-in ones run, too. A check takes the part and raises `Broken`, which says what is wrong and what to
do.
"""

from zpm2.contract.check import Broken, Finding, run

__all__ = ["Broken", "Finding", "run"]
