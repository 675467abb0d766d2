from pathlib import Path

from rendered import Pair, Run

QUICK = (
    "--runs",
    "1",
    "--set",
    "segment.model=classical",
    "--set",
    "segment.grid=4",
    "--set",
    "points.methods=sift",
    "--device",
    "cpu",
)


def test_report_and_comparison(run: Run, pair: Pair, tmp_path: Path) -> None:
    file = tmp_path / "before.json"
    assert run("bench", pair.left, pair.right, *QUICK, "--json", file, "-q") == (0, "", "")
    code, out, _ = run("bench", pair.left, pair.right, *QUICK, "--json", file)
    assert code == 0
    assert "pairs a second" in out
    assert "device cpu, precision float32, zpm2" in out
    code, out, _ = run("bench", pair.left, pair.right, *QUICK, "--compare", file)
    assert code == 0
    assert "ratio" in out


def test_misuse_is_one_line(run: Run, pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{}")
    for words, told in (
        ([pair.left], "pairs"),
        ([pair.left, pair.right, "--compare", tmp_path / "a.json"], "no report"),
        ([pair.left, tmp_path / "missing.png"], "does not exist"),
        ([pair.left, tmp_path / "missing.png", "--json", tmp_path], "there is a folder of that name"),
        (
            [pair.left, tmp_path / "missing.png", "--json", tmp_path / "no" / "a.json"],
            "does not exist; create it first",
        ),
    ):
        code, _, err = run("bench", *words, *QUICK, "-q")
        assert code == 2
        assert told in err
        assert err.count("\n") == 1
