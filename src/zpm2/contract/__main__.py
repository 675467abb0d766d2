"""`python -m zpm2.contract package.module:Class`: the checks of one part, a line each.

Exit code 0 where all is well, 1 where a check fails, 2 where there is nothing to check.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from zpm2.config import PointsConfig, assign, preset
from zpm2.contract import datasets, formats, points, segmenters
from zpm2.contract.check import Finding, run
from zpm2.errors import InputError, Zpm2Error
from zpm2.evaluate.datasets import DATASETS
from zpm2.evaluate.kinds import REGISTRIES, Kind, kind_of
from zpm2.features.protocol import PointMatcher
from zpm2.features.registry import METHODS
from zpm2.formats.registry import FORMATS
from zpm2.runtime import resolve_device
from zpm2.segment import registry
from zpm2.segment.protocol import PromptedSegmenter, Segmenter


def main(words: Sequence[str]) -> int:
    """Checks what the words name; returns the exit code."""
    options = _parser().parse_args(words)
    try:
        kind = kind_of(options.name)
        print(f"{options.name}: {kind}, {REGISTRIES[kind].origin(options.name)}")
        failed = 0
        for finding in _findings(kind, options.name, options.set, options.root):
            failed += finding.problem is not None
            print(f"  {'ok' if finding.problem is None else 'WRONG':<6} {finding.check}")
            if finding.problem is not None:
                print(f"         {finding.problem}")
    except Zpm2Error as error:
        print(f"zpm2: {error}", file=sys.stderr)
        return 2
    print("all is well" if not failed else f"{failed} of the checks failed")
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m zpm2.contract", description="Check a segmenter, point matcher, data set or format."
    )
    parser.add_argument("name", help="package.module:Class, or a registered name")
    parser.add_argument("--set", action="append", default=[], metavar="STAGE.FIELD=VALUE", help="as for zpm2 match")
    parser.add_argument("--root", type=Path, help="the folder of a data set; without it, no pair is looked at")
    return parser


def _findings(kind: Kind, name: str, settings: Sequence[str], root: Path | None) -> Iterator[Finding]:
    if kind == "data set":
        if root is not None and not root.is_dir():
            raise InputError(f"--root {root} is no folder: give the one that holds the data set")
        checks = datasets.CHECKS if root is None else {**datasets.CHECKS, **datasets.WITH_FILES}
        if root is None:
            print("  no --root FOLDER was given: no pair is looked at")
        return run(checks, datasets.Folder(DATASETS.get(name), root))
    if kind == "format":
        return run(formats.CHECKS, FORMATS.get(name))
    chosen, device = assign(preset("default"), settings), resolve_device("auto")
    if kind == "point matcher":
        METHODS.check([name], chosen.points.options)
        return run(points.CHECKS, cache(lambda side: _matcher(name, replace(chosen.points, max_size=side), device)))
    made: Segmenter = registry.create(replace(chosen.segment, model=name), device)
    if isinstance(made, PromptedSegmenter):
        print("  it takes prompts: regions of one photograph are looked for in the other")
    return run(segmenters.CHECKS, lambda image: made)


def _matcher(name: str, config: PointsConfig, device: str) -> PointMatcher:
    given = {"config": config, "device": device, "progress": None}
    made: PointMatcher = METHODS.build(name, given, config.options)
    return made


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
