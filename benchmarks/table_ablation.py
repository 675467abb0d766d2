"""Ablation: without the pyramid (fixed window), without LoJoGM (greedy by shape), without both.

    python benchmarks/table_ablation.py --data SceneFlow=sceneflow:DIR -o OUT

The variants are configuration: global_match.search=fixed, local_match.assign=greedy. They run on the polygons of the
first one, whose detection its seconds include. ACR by the paper's ground truth; good is the number of right matches
(dense truth, IoU 0.5) over all pairs.
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import ABLATION

FIXED, GREEDY = ["--set", "global_match.search=fixed"], ["--set", "local_match.assign=greedy"]
VARIANTS = {
    "Z(PM)²": [],
    "w/o pyramid": FIXED,
    "w/o LoJoGM": GREEDY,
    "w/o LoJoGM and pyramid": [*FIXED, *GREEDY],
}


def main() -> None:
    chosen = parser(__doc__).parse_args()
    rows = []
    for name, kind, folder in data_sets(chosen):
        for number, (label, words) in enumerate(VARIANTS.items()):
            s = measure(chosen, name, kind, folder, f"ablation{number}", words, regions="ablation0")
            rows.append([label, percent(s, "ACR_paper"), s["matches"], s["seconds"], s["good"], percent(s, "P")])
    show(["method", "ACR", "matches", "seconds", "good", "P"], [[*row, None, None] for row in ABLATION], rows)


if __name__ == "__main__":
    main()
