"""Relative pose: AUC at 5, 10 and 20 degrees.

    python benchmarks/table_pose.py --data ScanNet1500=scannet1500:DIR -o OUT

Both presets, and for each what the same points give without any polygon.
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import POSE


def main() -> None:
    chosen = parser(__doc__).parse_args()
    rows = []
    for name, kind, folder in data_sets(chosen):
        for preset in ("paper", "default"):
            s = measure(chosen, name, kind, folder, f"pose-{preset}", ["--preset", preset])
            for what, suffix in (("polygons", ""), ("all points", "_points")):
                auc = (percent(s, f"AUC{t}{suffix}") for t in (5, 10, 20))
                rows.append([f"zpm2 {preset}, {what}, {name}", *auc])
    show(["method", "AUC@5", "AUC@10", "AUC@20"], POSE, rows)


if __name__ == "__main__":
    main()
