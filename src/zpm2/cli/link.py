"""`zpm2 link`: which polygon of one layer is which of another, without photographs."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.console import bars, fresh_folder, warn
from zpm2.cli.options import AsJson, ConfigFile, MaxMemory, Out, Preset, Quiet, Settings, configure

if TYPE_CHECKING:
    from zpm2.linking import LinkResult


def link(
    left: Annotated[
        Path,
        typer.Argument(
            help="Layer of polygons: GeoPackage (FILE|layername=NAME), shapefile or GeoJSON, on the ground."
        ),
    ],
    right: Annotated[Path, typer.Argument(help="The other layer, in any reference system.")],
    out: Out = Path("zpm2-link"),
    preset: Preset = "default",
    config_file: ConfigFile = None,
    settings: Settings = None,
    max_memory: MaxMemory = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Link the polygons of two layers without photographs.

    Says which polygon of one layer is which of the other, by shape and neighbourhood only. The layers may be shifted
    and turned against each other. Writes links.json, the left layer in its own format with partners, confidences and
    shifts (regions.*), and a line for each shift (shifts.geojson).
    """
    from zpm2 import linking
    from zpm2.formats.regions.region import split_layer
    from zpm2.linking.result import file_names

    config = configure(preset, config_file, settings, max_memory=max_memory)
    first = linking.open_layer(left)
    inputs = (split_layer(path)[0] for path in (left, right))
    with fresh_folder(out, *inputs, names=file_names(first)), bars(quiet or as_json) as (progress, _):
        result = linking.link(first, right, config, progress=progress)
        result.save(out)
    _report(result, out, quiet, as_json)


def _report(result: "LinkResult", out: Path, quiet: bool, as_json: bool) -> None:
    warn(result.warnings)
    document = result.to_dict()
    if as_json:
        summary = {
            "links": len(result.links),
            "left_polygons": len(result.left.regions),
            "right_polygons": len(result.right.regions),
            **{name: document[name] for name in ("similarity", "failed", "timings", "warnings", "notes")},
            "unmatched": result.reasons(),
            "out": str(out),
        }
        print(json.dumps(summary))
    elif not quiet:
        found = document["similarity"]
        print(f"{len(result.links)} links of {len(result.left.regions)} and {len(result.right.regions)} polygons")
        if found is not None:
            (x, y), sigma = found["shift"], found["sigma"]
            print(
                f"shift {x:.2f}, {y:.2f} m (± {sigma['shift']:.2f}), turn {found['turn']:.3f} degrees "
                f"(± {sigma['turn']:.3f}), scale {found['scale']:.5f} (± {sigma['scale']:.5f})"
            )
        for side, reasons in result.reasons().items():
            if reasons:
                print(f"{side} without a link: {', '.join(f'{count} {reason}' for reason, count in reasons.items())}")
        print(f"in {out}")
