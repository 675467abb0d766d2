"""Masks of photographs for other programs: COLMAP, OpenMVS and Nerfstudio. All ignore what is black (0).

- COLMAP, `--ImageReader.mask_path FOLDER`: the photograph's file name and `.png` (https://colmap.github.io/faq.html).
- OpenMVS, `--mask-path FOLDER --ignore-mask-label 0`: its name without ending and `.mask.png`.
- Nerfstudio: any place that the frame's `mask_path` in `transforms.json` names, one channel of black and white
  (https://docs.nerf.studio/quickstart/data_conventions.html).
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2 import memory
from zpm2.errors import ConfigError, InputError, did_you_mean
from zpm2.files.reading import read_json
from zpm2.files.record import make_folder
from zpm2.files.writing import atomic_write
from zpm2.formats.convert import Members
from zpm2.formats.regions.outlines import pixels_of
from zpm2.formats.regions.region import Photograph, Shape, name_of

FOLDER = "masks"  # in the folder of results
TRANSFORMS = "transforms.json"  # of a data set of Nerfstudio
NAMES: Mapping[
    str, Callable[[str], str]
] = {  # tool -> from a photograph's file name to its mask below the tool's folder
    "colmap": lambda name: f"{name}.png",
    "openmvs": lambda name: f"{PureWindowsPath(name).stem}.mask.png",
    "nerfstudio": lambda name: f"{FOLDER}/{PureWindowsPath(name).stem}.png",
}


@dataclass(frozen=True, eq=False)
class RegionMask:
    """Where regions are in a photograph."""

    photograph: Photograph
    regions: Sequence[Shape] | NDArray[np.integer]  # px; or (h, w) labels, 0 = none

    def bits(self) -> NDArray[np.bool_]:
        """(h, w) the pixels of the regions. `InputError` for labels of another size, and for too little memory."""
        photograph = self.photograph
        width, height = photograph.width, photograph.height
        memory.refuse_above(3.0 * width * height, f"the mask of {name_of(photograph)}", "write no masks of it")
        if isinstance(self.regions, np.ndarray):
            if self.regions.shape != (height, width):
                raise InputError(f"labels of {name_of(photograph)} must be of its size, {width} x {height} px")
            return np.asarray(self.regions != 0)
        found = np.zeros((height, width), bool)
        for shape in self.regions:
            mask = pixels_of(shape, photograph)
            rows, columns = mask.bits.shape
            found[mask.y0 : mask.y0 + rows, mask.x0 : mask.x0 + columns] |= mask.bits
        return found


def check_tools(tools: Sequence[str]) -> None:
    """`ConfigError` for a program without masks here."""
    for tool in tools:
        if tool not in NAMES:
            raise ConfigError(f"no masks for '{tool}'{did_you_mean(tool, NAMES)}; there are: {', '.join(NAMES)}")


def check_names(tools: Sequence[str], photographs: Sequence[str | Path]) -> None:
    """`ConfigError` for a program without masks here, and for photographs whose masks would have one name."""
    check_tools(tools)
    for tool in tools:
        masks = Counter(NAMES[tool](Path(photograph).name) for photograph in photographs)
        if twice := [name for name, count in masks.items() if count > 1]:
            raise ConfigError(f"{tool} would get several masks named {twice[0]}: rename one of the photographs")


def write_masks(folder: Path, tools: Sequence[str], masks: Sequence[RegionMask], keep: bool) -> list[str]:
    """Writes the masks of some photographs for some programs (`NAMES`), each into a folder of its name below `folder`;
    returns warnings for the user.

    keep: regions are white and all else is ignored; else the regions are ignored. Nerfstudio's folder also gets
    `transforms.json`: that of the data set in which the photographs lie, with "mask_path" in their frames, or else the
    paths alone. `ConfigError` as from `check_names`, `OutputError`.
    """
    chosen = list(dict.fromkeys(tools))
    check_names(chosen, [name_of(mask.photograph) for mask in masks])
    make_folder(folder)
    for tool in chosen:
        make_folder(folder / tool)
    if "nerfstudio" in chosen:
        make_folder(folder / "nerfstudio" / FOLDER)
    for mask in masks:
        bits = mask.bits()
        content = bytes(cv2.imencode(".png", np.where(bits == keep, np.uint8(255), np.uint8(0)))[1].tobytes())
        for tool in chosen:
            atomic_write(folder / tool / NAMES[tool](name_of(mask.photograph)), content)
    return _write_transforms(folder / "nerfstudio", masks) if "nerfstudio" in chosen else []


def _write_transforms(folder: Path, masks: Sequence[RegionMask]) -> list[str]:
    names = [name_of(mask.photograph) for mask in masks]
    mask_of = {name: NAMES["nerfstudio"](name) for name in names}
    found = next((each for mask in masks if (each := _transforms_of(mask.photograph.path)) is not None), None)
    if found is None:
        frames: list[Members] = [{"file_path": name, "mask_path": mask} for name, mask in mask_of.items()]
        atomic_write(folder / TRANSFORMS, json.dumps({"frames": frames}, indent=1))
        return [f"there is no {TRANSFORMS} around the photographs: that of the masks has no cameras, only their paths"]
    path, content = found
    bare = 0
    for frame in content["frames"]:
        name = PurePosixPath(frame["file_path"]).name
        if name in mask_of:
            frame["mask_path"] = mask_of[name]
        bare += "mask_path" not in frame
    atomic_write(folder / TRANSFORMS, json.dumps(content, indent=1))
    if bare:
        return [f"frames without a mask in {path}: {bare}; Nerfstudio wants one for each frame or for none"]
    return []


def _transforms_of(photograph: str | None) -> tuple[Path, Members] | None:
    """The data set of Nerfstudio in which a photograph lies, as it or a folder above it has it."""
    if photograph is None:
        return None
    for folder in Path(photograph).absolute().parents[:2]:
        path = folder / TRANSFORMS
        if not path.is_file():
            continue
        try:
            content = read_json(path)
        except (OSError, ValueError):
            continue
        frames = content.get("frames") if isinstance(content, dict) else None
        if isinstance(frames, list) and all(
            isinstance(f, dict) and isinstance(f.get("file_path"), str) for f in frames
        ):
            return path, content
    return None
