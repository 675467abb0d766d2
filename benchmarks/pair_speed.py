"""How fast two versions of the source match the same pairs, in turns: CPU seconds by stage, and whether results agree.

    python benchmarks/pair_speed.py --before OTHER_CHECKOUT --runs 5 LEFT RIGHT [LEFT RIGHT]... > pair_speed.json

Each version runs in a process of its own, one at a time. What the networks say and where points are is remembered from
the first run of the version `--before` (the networks are the same in both), so that only the work of the processor is
left. CPU seconds are those of the process: other work on the machine does not count. With `--synthetic`, the matcher
alone on pairs of matcher_growth.py is timed too.
"""

import argparse
import dataclasses
import functools
import hashlib
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import document

SCHEMA = "zpm2-bench-speed/1"
HERE = Path(__file__).parent
GRIDS = {"synthetic 200": (20, 10), "synthetic 2000": (50, 40)}


def work(store: Path) -> None:
    """A worker: reads names or pairs as JSON from stdin, a line each, and answers with digest and seconds."""
    sys.path[:0] = [str(HERE.parent / "tests")]
    import zpm2.runtime
    from zpm2.api import Matcher

    zpm2.runtime.perf_counter = process_time
    matcher = Matcher("default")
    for line in sys.stdin:
        asked = json.loads(line)
        if isinstance(asked, str):
            answer = synthetic(*GRIDS[asked])
        else:
            with remembered(store / f"{abs(hash(tuple(asked)))}.pickle"):
                start = process_time()
                result = matcher(*asked)
                total = process_time() - start
            seconds = {**result.timings, "total": total, "other": total - sum(result.timings.values())}
            answer = {"digest": digest(result.to_dict()), "matches": len(result.matches), "seconds": seconds}
        print(json.dumps(answer), flush=True)


def synthetic(columns: int, rows: int) -> dict[str, Any]:
    """The matcher alone, on polygons in the cells of a grid."""
    import matcher_growth

    from zpm2.config import preset

    matcher_growth.perf_counter = process_time
    found = matcher_growth.run(matcher_growth.synthetic_pair(columns, rows), preset("default"))
    seconds = {"total": found["seconds"], "global": found["global_seconds"], "local": found["local_seconds"]}
    return {"digest": f"{found['matches']} {found['right']}", "matches": found["matches"], "seconds": seconds}


def digest(result: dict[str, Any]) -> str:
    """Of everything but times."""
    return hashlib.sha256(json.dumps({**result, "timings": None}, sort_keys=True).encode()).hexdigest()[:16]


@functools.lru_cache(1)
def read(file: Path) -> dict[Any, Any]:
    return dict(pickle.loads(file.read_bytes()))


@contextmanager
def remembered(file: Path) -> Iterator[None]:
    """Within it, the networks' answers and the points of a pair come from `file`, written where it is not there."""
    from zpm2.global_match.pair_points import PointFinder
    from zpm2.segment.mask_view import MaskView
    from zpm2.segment.sam_input import ENCODER_SIDE
    from zpm2.segment.sam_view import SamView

    known = read(file) if file.exists() else {}
    new, first = not known, SamView.__init__
    predict, small, find = SamView.predict, SamView.predict_small, PointFinder.__call__

    def encoded(view: Any, backend: Any, image: Any, config: Any, *more: Any) -> None:
        if new:
            first(view, backend, image, config, *more)
        else:
            MaskView.__init__(view, image, ENCODER_SIDE)
            view.backend, view.config, view.batch = backend, config, backend.batch
        view.of = hashlib.sha256(image.rgb.tobytes()).hexdigest()

    def asked(answer: Callable[..., Any], view: Any, prompts: Any, thresholds: Any, *more: Any) -> Any:
        areas = [part.extent.area.tolist() for masks in more[:1] for part in masks]
        key = view.of, hashlib.sha256(prompts.points.tobytes()).hexdigest(), str(prompts.labels), str(thresholds)
        key = *key, hashlib.sha256(str(areas).encode()).hexdigest()
        if key not in known:
            known[key] = answer(view, prompts, thresholds, *more)
        return known[key]

    def found(finder: Any, *asked: Any) -> Any:
        if "points" not in known:
            known["points"] = find(finder, *asked)
        return dataclasses.replace(known["points"], initial=dataclasses.replace(known["points"].initial))

    def predicted(view: Any, *asking: Any) -> Any:
        return asked(predict, view, *asking)

    def predicted_small(view: Any, *asking: Any) -> Any:
        return asked(small, view, *asking)

    SamView.__init__, PointFinder.__call__ = encoded, found
    SamView.predict, SamView.predict_small = predicted, predicted_small
    try:
        yield
    finally:
        SamView.__init__, PointFinder.__call__ = first, find
        SamView.predict, SamView.predict_small = predict, small
    if new:
        file.write_bytes(pickle.dumps(known))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", nargs="*")
    parser.add_argument("--before", type=Path, required=True, help="folder of the other version's checkout")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--synthetic", action="store_true")
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(given.work)
        return
    pairs = [list(pair) for pair in zip(given.photographs[::2], given.photographs[1::2], strict=True)]
    rows = []
    with TemporaryDirectory() as store:
        versions = {"before": given.before.resolve(), "now": HERE.parent}
        command = [sys.executable, __file__, "--before", ".", "--work", store]
        workers = {
            name: subprocess.Popen(
                command,
                env={**os.environ, "PYTHONPATH": str(folder / "src"), "PYTHONHASHSEED": "0"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for name, folder in versions.items()
        }
        for asked in [*pairs, *(GRIDS if given.synthetic else ())]:
            answers: dict[str, list[dict[str, Any]]] = {name: [] for name in workers}
            for run in range(given.runs + 1):
                for name, worker in workers.items():
                    assert worker.stdin is not None
                    assert worker.stdout is not None
                    print(json.dumps(asked), file=worker.stdin, flush=True)
                    answer = json.loads(worker.stdout.readline())
                    if run:  # the first one is not warm
                        answers[name].append(answer)
            rows.append(compared(asked, answers))
            print(rows[-1], file=sys.stderr)
        for worker in workers.values():
            worker.communicate()
    print(document.text(SCHEMA, runs=given.runs, rows=rows))


def compared(asked: str | list[str], answers: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Medians of both versions by stage, and their ratio."""
    middle = {
        name: {stage: median(each["seconds"].get(stage, 0.0) for each in all_) for stage in all_[0]["seconds"]}
        for name, all_ in answers.items()
    }
    stages = [stage for stage in middle["now"] if stage not in ("read", "load", "points")]
    return {
        "pair": asked if isinstance(asked, str) else " - ".join("/".join(Path(path).parts[-2:]) for path in asked),
        "same_result": len({each["digest"] for all_ in answers.values() for each in all_}) == 1,
        "matches": answers["now"][0]["matches"],
        **{name: {stage: round(values[stage], 3) for stage in stages} for name, values in middle.items()},
        "ratio": {stage: round(middle["before"][stage] / max(middle["now"][stage], 1e-4), 2) for stage in stages},
    }


if __name__ == "__main__":
    main()
