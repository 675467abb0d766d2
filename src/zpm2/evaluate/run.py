"""An evaluation by one call: every pair of a data set matched, and scored against its ground truth."""

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from zpm2 import api
from zpm2.config import Config, preset
from zpm2.errors import InputError
from zpm2.evaluate import predictions, report
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import EvalPair, PoseTruth
from zpm2.evaluate.predicted_regions import PredictedRegions
from zpm2.evaluate.report import Row
from zpm2.files.keys import code
from zpm2.pipeline import plugin_code
from zpm2.pose import PoseFinder, PoseResult
from zpm2.result import MatchResult
from zpm2.runtime import resolve_device


@dataclass(frozen=True)
class Evaluation:
    """A data set, and the method that its pairs are matched with.

    rows = Evaluation("pairs", "data").run("scores")
    """

    dataset: str  # a name of `evaluate.datasets.DATASETS`
    root: str | Path
    split: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)  # of the data set
    limit: int | None = None  # only the first so many pairs
    method: str = "zpm2"  # a name of `api.METHODS`
    config: Config = field(default_factory=lambda: preset("default"))
    regions: Path | None = None  # folder of an evaluation whose polygons are taken, so that none are detected

    def run(
        self,
        out: str | Path,
        *,
        score_only: bool = False,
        parquet: bool = False,
        title: str | None = None,
        made_by: str = "",
        tell: Callable[[str], None] = lambda text: None,
    ) -> list[Row]:
        """Match the pairs and score them. A folder `out` gets the predictions and the tables of `report.write`; the
        rows of these tables are returned.

        Pairs that have a prediction there are not matched again. score_only: match none at all; `InputError` where
        `out` holds no predictions. parquet: write rows.parquet too. title, made_by: printed above the tables. `tell`
        is given a line for each pair. Errors are those of `open_dataset` and `predictions.Run.claim`.
        """
        folder = Path(out)
        api.check_method(self.method)
        if parquet:
            report.require_parquet()
        pairs = self.pairs()
        if score_only and not (folder / predictions.RUN).exists():
            raise InputError(f"{folder} holds no predictions: run the same command without --score-only first")
        if not score_only:
            self._predict(pairs, folder, _numbered(tell, "matched", len(pairs)))
        rows = report.collect(pairs, folder, _numbered(tell, "scored", len(pairs)))
        shown = f"{self.dataset}, {self.method}" if title is None else title
        report.write(shown, rows, folder, made_by, parquet, self.published(rows))
        return rows

    def pairs(self) -> list[EvalPair]:
        """The pairs that are evaluated."""
        listed = open_dataset(self.dataset, self.root, self.split, **self.options).pairs()
        return list(itertools.islice(listed, self.limit))

    def published(self, rows: Sequence[Row]) -> str:
        """A table of published figures beside the measured ones, where there are any for the data set."""
        return report.pose_table(rows) if self.dataset == "scannet1500" else ""

    def _predict(self, pairs: Sequence[EvalPair], out: Path, tell: Callable[[str], None]) -> None:
        kept = PredictedRegions(self.regions) if self.regions else None
        source = str(self.regions.resolve()) if self.regions else None
        made_by = "-".join([code(), *plugin_code(self.config)])
        predictions.PredictionSettings(
            self.dataset, self.split, self.method, self.config.to_dict(), source, code=made_by
        ).claim(out)
        posed = _posed(self.config) if self.method == "zpm2" else lambda pair, result: None
        matcher = functools.partial(_matcher, self.method, self.config, kept)
        predictions.predict(pairs, matcher, out, tell, posed, self.regions)


def file_names(parquet: bool = False) -> list[str]:
    """The names of the files and folders that `Evaluation.run` may write."""
    return [predictions.RUN, predictions.PREDICTIONS, *report.names(parquet)]


def _matcher(method: str, config: Config, kept: PredictedRegions | None) -> predictions.MatchPair:
    """The method as a function of a pair of a data set."""
    match = api.open_method(method, config, segmenter=kept.sides if kept else None)

    def of(pair: EvalPair) -> MatchResult:
        if kept:
            kept.set_pair(pair)
        return match(pair.left, pair.right)

    return of


def _posed(config: Config) -> predictions.FindPose:
    """The pose of a pair whose cameras are known."""
    finder = PoseFinder(config, device=resolve_device(config.device))

    def of(pair: EvalPair, result: MatchResult) -> PoseResult | None:
        truth = pair.truth
        return finder(result, report.cameras_of(result, truth)) if isinstance(truth, PoseTruth) else None

    return of


def _numbered(tell: Callable[[str], None], what: str, total: int) -> Callable[[str], None]:
    """Tells how many pairs are done."""
    count = itertools.count(1)
    return lambda text: tell(f"{what} {next(count)} of {total}: {text}")
