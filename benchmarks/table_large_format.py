"""Pyramid levels on large images: all levels, two levels, and a fixed range instead of the pyramid.

    python benchmarks/table_large_format.py --data ISPRS=isprs:DIR -o OUT

Without ground truth there is no ACR; matches and seconds (whole run, and the global stage alone) are printed.
"""

from paper_tables import data_sets, measure, parser, percent, show

from zpm2.evaluate.published import LARGE_FORMAT

VARIANTS = {
    "full": [],
    "L = 2": ["--set", "global_match.max_layers=2"],
    "fixed range": ["--set", "global_match.search=fixed"],
}


def main() -> None:
    chosen = parser(__doc__).parse_args()
    rows = []
    for name, kind, folder in data_sets(chosen):
        for label, words in VARIANTS.items():
            s = measure(chosen, name, kind, folder, label.replace(" ", ""), words)
            rows.append([label, name, s["seconds"], s["s_global"], percent(s, "ACR"), s["matches"]])
    published = [[r.method, r.resolution, r.seconds, None, r.acr, r.matches] for r in LARGE_FORMAT]
    show(["method", "images", "seconds", "global stage s", "ACR", "matches"], published, rows)


if __name__ == "__main__":
    main()
