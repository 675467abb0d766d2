"""Recall, precision, F1 and ACR, by the paper's ground truth (projected centres) and by the dense one at IoU 0.5.

python benchmarks/table_discrete.py --data SceneFlow=sceneflow:DIR --data KITTI=kitti2015:DIR -o OUT
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import DISCRETE


def main() -> None:
    chosen = parser(__doc__).parse_args()
    rows, names = [], set()
    for name, kind, folder in data_sets(chosen):
        names.add(name)
        s = measure(chosen, name, kind, folder, "zpm2")
        for truth, suffix in (("projected centres", "_paper"), ("dense, IoU 0.5", "")):
            figures = [percent(s, f"R{suffix}"), percent(s, f"P{suffix}"), s.get(f"F1{suffix}")]
            rows.append([name, truth, *figures, percent(s, f"ACR{suffix}")])
    published = [[row.dataset, "projected centres", *row[1:]] for row in DISCRETE if row.dataset in names]
    show(["data set", "ground truth", "recall", "precision", "F1", "ACR"], published, rows)


if __name__ == "__main__":
    main()
