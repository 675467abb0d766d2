"""Large-format aerial photographs, as those of ISPRS (Rottensteiner et al. 2013): blocks without truth."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from zpm2.errors import InputError
from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import EvalPair
from zpm2.files.listing import existing, folders, text
from zpm2.photos.listing import photographs


@dataset("isprs", truth="none")
def pairs(root: Path, split: str | None) -> Iterator[EvalPair]:
    """The pairs of every block of photographs: those of its `pairs.txt` (a line: left right), else file and next file.

    A block is `root` where it holds photographs or a `pairs.txt`, else each folder in it. split: one of these folders.
    The end of a strip and the start of the next one are neighbours by file order without any overlap: list the pairs
    where this matters. The truth is None; for oriented photographs write a `pairs.json` (data set `pairs`).
    """
    blocks = [existing(root / split)] if split else [root] if _is_block(root) else folders(root)
    looked = root / split if split else root
    return found((pair for block in blocks for pair in _pairs(block)), f"two photographs in {looked}")


def _is_block(folder: Path) -> bool:
    return (folder / "pairs.txt").exists() or bool(photographs(folder))


def _pairs(block: Path) -> Iterator[EvalPair]:
    images = photographs(block)
    listed = block / "pairs.txt"
    chosen = _listed(listed) if listed.exists() else pairwise(images)
    for left, right in chosen:
        yield EvalPair(path_name(block.resolve().name, f"{left.stem}-{right.stem}"), left, right)


def _listed(path: Path) -> Iterator[tuple[Path, Path]]:
    for number, line in enumerate(text(path).splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 2:
            raise InputError(f"{path} line {number} has {len(words)} words: write the left and the right file name")
        yield existing(path.parent / words[0]), existing(path.parent / words[1])
