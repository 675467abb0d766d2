"""The segmenter's size: recall, precision and F1 (dense truth, IoU 0.5) with each SAM.

python benchmarks/table_sam_size.py --data SceneFlow=sceneflow:DIR -o OUT [--models vit_b]
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import SAM_SIZES


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--models", nargs="+", default=["mobile_sam", "vit_b", "vit_l", "vit_h"])
    chosen = options.parse_args()
    rows = []
    for name, kind, folder in data_sets(chosen):
        for model in chosen.models:
            s = measure(chosen, name, kind, folder, model, ["--set", f"segment.model={model}"])
            rows.append([f"{model}, {name}", percent(s, "R"), percent(s, "P"), s.get("F1"), s["seconds"]])
    published = [[row.model, row.recall, row.precision, row.f1, None] for row in SAM_SIZES]
    show(["model", "recall", "precision", "F1", "seconds"], published, rows)


if __name__ == "__main__":
    main()
