"""`zpm2 demo`: a rendered pair, matched and scored."""

from pathlib import Path

from zpm2.cli.console import bars, fresh_folder
from zpm2.cli.match import report
from zpm2.cli.options import (
    AsJson,
    Device,
    MaxMemory,
    Out,
    Preset,
    Quiet,
    Seed,
    Settings,
    WeightsDir,
    configure,
    use_weights,
)


def demo(
    out: Out = Path("zpm2-demo"),
    preset: Preset = "default",
    settings: Settings = None,
    device: Device = None,
    seed: Seed = None,
    max_memory: MaxMemory = None,
    weights_dir: WeightsDir = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Render a stereo pair, match it and score the matches.

    The rendered pair has an exact depth to score against; the matching is that of zpm2 match. Writes left.png and
    right.png, the files of zpm2 match, and the true regions of both images, left_labels.png and right_labels.png: with
    them you can try --left-regions and --right-regions.
    """
    from zpm2 import api
    from zpm2.evaluate import rendered
    from zpm2.formats.saving import file_names

    config = configure(preset, None, settings, device=device, seed=seed, max_memory=max_memory)
    use_weights(weights_dir)
    names = [*rendered.NAMES, *file_names()]
    with fresh_folder(out, names=names), bars(quiet or as_json) as (progress, say):
        progress("render", 0.0)
        scene = rendered.render_scene(config.seed)
        left, right = rendered.save_scene(scene, out)
        progress("render", 1.0)
        result = api.Matcher(config, progress=progress, say=say)(left, right)
        result.save(out, report=True)
    truth = rendered.score_on_disparity(result.left.polygons, result.right.polygons, result.matches, scene.disparity)
    report(result, out, quiet, as_json, {"good": truth.good, "scored": truth.scored, "coverage": truth.coverage})
    if not (quiet or as_json):
        print(
            f"Against the exact depth: {truth.good} of {truth.scored} matches right (IoU >= 0.5), "
            f"{truth.coverage:.0%} of the area that both cameras see is covered."
        )
        print(f"Open {out / 'report.html'} in a browser, then try your own pair: zpm2 match left.png right.png -o out")
