"""DTU multi-view stereo (Jensen et al. 2014) in the layouts of MVSNet and of IDR / NeuS: calibrated table-top views."""

from collections.abc import Iterator
from pathlib import Path

from zpm2.errors import InputError
from zpm2.evaluate.datasets.layout import found, path_name
from zpm2.evaluate.datasets.registry import dataset
from zpm2.evaluate.pairs import Array, EvalPair, PoseTruth
from zpm2.files.listing import existing, folders, text
from zpm2.formats import cameras
from zpm2.photos.listing import photographs

_CAMERAS = ("cameras.npz", "cameras_sphere.npz")


@dataset("dtu", truth="pose")
def pairs(root: Path, split: str | None) -> Iterator[EvalPair]:
    """Neighbouring views of every scan below `root`, or of `root` itself.

        MVSNet      scan1/images/00000000.jpg, cams/00000000_cam.txt, pair.txt: each view with its best source view
        IDR, NeuS   scan65/image/000000.png, cameras.npz or cameras_sphere.npz: each view with the next one

    Both count pixel centres from 0. Translations are in mm: world_mat alone is decomposed, since scale_mat only moves
    and scales the world. split: one scan; None for all.
    """
    scans = [existing(root / split)] if split else [root] if _is_scan(root) else folders(root)
    looked = [root / (split or "scanN") / file for file in ("cams", *_CAMERAS)]
    return found((pair for scan in scans if _is_scan(scan) for pair in _pairs(scan)), *looked)


def _is_scan(folder: Path) -> bool:
    return any((folder / file).exists() for file in ("cams", *_CAMERAS))


def _pairs(scan: Path) -> Iterator[EvalPair]:
    return _mvsnet(scan) if (scan / "cams").is_dir() else _idr(scan)


def _mvsnet(scan: Path) -> Iterator[EvalPair]:
    for left, right in _neighbours(scan / "pair.txt"):
        images = [
            existing(scan / "images" / f"{view:08d}.jpg", scan / "images" / f"{view:08d}.png") for view in (left, right)
        ]
        views = [cameras.mvsnet(scan / "cams" / f"{view:08d}_cam.txt") for view in (left, right)]
        yield _pair(scan, images, views)


def _neighbours(path: Path) -> list[tuple[int, int]]:
    """Each view with the first (best) of its source views, each pair of views once."""
    words = iter(text(path).split())
    chosen: list[tuple[int, int]] = []
    try:
        for _ in range(int(next(words))):
            view, count = int(next(words)), int(next(words))
            sources = [(int(next(words)), float(next(words)))[0] for _ in range(count)]
            if sources and (sources[0], view) not in chosen:
                chosen.append((view, sources[0]))
    except (ValueError, StopIteration) as error:
        raise InputError(f"{path} is not a pair file of MVSNet, or is cut short: copy or download it again") from error
    return chosen


def _idr(scan: Path) -> Iterator[EvalPair]:
    file = existing(*(scan / name for name in _CAMERAS))
    worlds = cameras.archive(file)
    images = photographs(scan / "image", (".png", ".jpg"))
    count = sum(name.startswith("world_mat_") and name[10:].isdecimal() for name in worlds)
    if len(images) != count:
        raise InputError(f"{scan / 'image'} holds {len(images)} images, {file} {count} cameras: complete the download")
    for index in range(count - 1):
        views = [cameras.idr(worlds, k, file) for k in (index, index + 1)]
        yield _pair(scan, images[index : index + 2], views)


def _pair(scan: Path, images: list[Path], views: list[tuple[Array, Array]]) -> EvalPair:
    (k0, left), (k1, right) = views
    truth = PoseTruth((cameras.intrinsics(k0), cameras.intrinsics(k1)), cameras.between(left, right))
    name = path_name(scan.resolve().name, f"{images[0].stem}-{images[1].stem}")
    return EvalPair(name, images[0], images[1], truth)
