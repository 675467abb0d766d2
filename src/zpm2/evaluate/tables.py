"""The tables of the paper as data: which rows it prints, what stands for each of them here, and what others would need.

Numbers are those of the paper's section 4, in its order. `table_run` runs them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from zpm2.evaluate import published

OURS = "zpm2"


@dataclass(frozen=True)
class Line:
    """A line that is measured here."""

    label: str
    stands_for: str = ""  # the method of the published rows beside it
    method: str = "zpm2"  # of `api.METHODS`
    settings: tuple[str, ...] = ()  # laid over the configuration, STAGE.FIELD=VALUE
    regions: str = ""  # the label of the line whose polygons it takes; empty: it detects its own
    run: str = ""  # the label of the line whose run it is another view of
    keys: Mapping[str, str] = field(
        default_factory=dict
    )  # by column, the figure of the summary where it is another one


@dataclass(frozen=True)
class Table:
    """A table of the paper."""

    title: str
    columns: Mapping[str, str]  # header -> figure of `report.summary`; "%" at its end: in per cent
    # the paper's rows: data set ("" for any), method, the columns (None: not there)
    printed: Sequence[tuple[str | float | None, ...]]
    lines: Sequence[Line]
    needs: Mapping[str, str] = field(
        default_factory=dict
    )  # by published method that no line stands for, what it would need


def _points(name: str) -> tuple[str, ...]:
    return (f"points.methods={name}",)


FIXED, GREEDY = "global_match.search=fixed", "local_match.assign=greedy"
LIGHTGLUE, LOFTR = "Z(PM)² + SuperPoint + LightGlue", "Z(PM)² + LoFTR"

TABLES: Mapping[int, Table] = {
    1: Table(
        "Matching area score",
        {"MAS40": "MAS40%", "MAS50": "MAS50%", "MAS80": "MAS80%", "matches": "matches", "seconds": "seconds"},
        [tuple(row) for row in published.MATCHING],
        (
            Line(OURS),
            Line("zpm2, SuperPoint + LightGlue", LIGHTGLUE, settings=_points("superpoint"), regions=OURS),
            Line("zpm2, LoFTR", LOFTR, settings=_points("loftr-outdoor"), regions=OURS),
            Line("point vote", method="vote", regions=OURS),
            Line("MESA, our implementation", "MESA", method="mesa", regions=OURS),
            Line("SGAM, our implementation", "SGAM", method="sgam", regions=OURS),
            Line("MASA's association, ours", "MASA", method="masa", regions=OURS),
            Line("Shape Context, ours", "Shape Context", method="shape-context", regions=OURS),
            Line("IDSC, ours", "IDSC", method="idsc", regions=OURS),
        ),
    ),
    2: Table(
        "Recall, precision, F1 and coverage",
        {"recall": "R_paper%", "precision": "P_paper%", "F1": "F1_paper", "ACR": "ACR_paper%"},
        [(row.dataset, "Z(PM)²", *row[1:]) for row in published.DISCRETE],
        (
            Line("zpm2, truth of projected centres", "Z(PM)²"),
            Line(
                "zpm2, dense truth, IoU 0.5",
                run="zpm2, truth of projected centres",
                keys={"recall": "R%", "precision": "P%", "F1": "F1", "ACR": "ACR%"},
            ),
        ),
    ),
    3: Table(
        "Size of SAM, dense truth",
        {"recall": "R%", "precision": "P%", "F1": "F1", "seconds": "seconds"},
        [("", *row, None) for row in published.SAM_SIZES],
        [
            Line(f"zpm2, {name}", name, settings=(f"segment.model={name}",))
            for name in ("vit_h", "vit_l", "vit_b", "mobile_sam")
        ],
    ),
    4: Table(
        "Large photographs, levels of the pyramid",
        {"seconds": "seconds", "global stage s": "s_global", "ACR": "ACR%", "matches": "matches"},
        [("", f"{r.method}, {r.resolution}", r.seconds, None, r.acr, r.matches) for r in published.LARGE_FORMAT],
        (
            Line("zpm2, all levels", "Z(PM)² (full)"),
            Line("zpm2, L = 2", "Z(PM)² (L = 2)", settings=("global_match.max_layers=2",)),
            Line("zpm2, fixed range", "fixed range", settings=(FIXED,)),
        ),
    ),
    5: Table(
        "Ablation",
        {"ACR": "ACR_paper%", "matches": "matches", "seconds": "seconds", "good": "good", "P": "P%"},
        [("", *row, None, None) for row in published.ABLATION],
        (
            Line(OURS, "Z(PM)²"),
            Line("zpm2 w/o pyramid", "w/o pyramid", settings=(FIXED,), regions=OURS),
            Line("zpm2 w/o LoJoGM", "w/o LoJoGM", settings=(GREEDY,), regions=OURS),
            Line("zpm2 w/o both", "w/o LoJoGM and pyramid", settings=(FIXED, GREEDY), regions=OURS),
        ),
    ),
    6: Table(
        "Relative pose",
        {"AUC@5": "AUC5%", "AUC@10": "AUC10%", "AUC@20": "AUC20%"},
        [("", *row) for row in published.POSE],
        (
            Line(OURS, "Z(PM)²"),
            Line(
                "all points of zpm2, no polygons",
                run=OURS,
                keys={"AUC@5": "AUC5_points%", "AUC@10": "AUC10_points%", "AUC@20": "AUC20_points%"},
            ),
            Line("MESA, our implementation, LoFTR", "MESA + LoFTR", "mesa", _points("loftr-indoor"), OURS),
            Line("SGAM, our implementation, LoFTR", "SEEM + SGAM + LoFTR", "sgam", _points("loftr-indoor"), OURS),
            Line(
                "LoFTR, no polygons",
                "LoFTR",
                run="MESA, our implementation, LoFTR",
                keys={"AUC@5": "AUC5_points%", "AUC@10": "AUC10_points%", "AUC@20": "AUC20_points%"},
            ),
            Line("MESA, our implementation", method="mesa", regions=OURS),
            Line("SGAM, our implementation", method="sgam", regions=OURS),
        ),
        {
            "SP + SGMNet": "the matcher SGMNet and its weights",
            "SiLK": "the detector SiLK and its weights",
        },
    ),
}


def here(table: Table, method: str) -> str:
    """What there is of a published method here, in a few words."""
    own = {line.stands_for: line.label for line in table.lines}
    names = [own[name] for name in (method, method.split(", ")[0]) if name in own]
    if names:
        return f"see: {names[0]}"
    return f"would need {table.needs[method]}" if method in table.needs else "published only"
