"""Table 1: matching area score of the methods on the data sets.

    python benchmarks/table_matching.py --data SceneFlow=sceneflow:DIR --data KITTI=kitti2015:DIR -o OUT

Methods run here: zpm2 (preset paper) and, on the same polygons, the classical baselines (--baselines). MAS in %,
seconds a pair; those of the baselines are without the detection of the polygons.
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import MATCHING


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--baselines", action="store_true", help="Shape Context and IDSC too, which take long")
    chosen = options.parse_args()
    methods = ["zpm2", *(["shape-context", "idsc"] if chosen.baselines else [])]
    rows, names = [], set()
    for name, kind, folder in data_sets(chosen):
        names.add(name)
        for method in methods:
            s = measure(chosen, name, kind, folder, method, ["--method", method], regions="zpm2")
            mas = [percent(s, f"MAS{t}") for t in (40, 50, 80)]
            rows.append([name, method, *mas, s["matches"], s["seconds"]])
    columns = ["data set", "method", "MAS40", "MAS50", "MAS80", "matches", "seconds"]
    show(columns, [row for row in MATCHING if row.dataset in names], rows)


if __name__ == "__main__":
    main()
