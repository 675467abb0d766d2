"""Relative pose: AUC at 5, 10 and 20 degrees.

    python benchmarks/table_pose.py --data ScanNet1500=scannet1500:DIR -o OUT

What runs here is the pose of all homologous points (five-point, MAGSAC++), no polygon taking part yet.
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import POSE


def main() -> None:
    chosen = parser(__doc__).parse_args()
    rows = []
    for name, kind, folder in data_sets(chosen):
        s = measure(chosen, name, kind, folder, "pose")
        rows.append([f"zpm2, all points, {name}", *(percent(s, f"AUC{t}") for t in (5, 10, 20))])
    show(["method", "AUC@5", "AUC@10", "AUC@20"], POSE, rows)


if __name__ == "__main__":
    main()
