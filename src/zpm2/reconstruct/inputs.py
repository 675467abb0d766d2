"""The input of a reconstruction: photographs, and their cameras if they are known."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from zpm2.cloud.workspace import read_views
from zpm2.errors import ConfigError
from zpm2.files.listing import distinct_names
from zpm2.model import PosedCamera
from zpm2.photos.images import read_image
from zpm2.photos.listing import some_photographs


@dataclass(frozen=True, eq=False)
class Inputs:
    """Photographs that can be read, and their cameras by name (`files.listing.distinct_names`), if they are known."""

    photographs: Sequence[Path]
    cameras: Mapping[str, PosedCamera] | None = None
    warnings: Sequence[str] = ()  # doubts about the cameras


def read_inputs(images: Sequence[Path], cameras: Path | None = None) -> Inputs:
    """The photographs of a folder, or those given by name.

    Each is read once, so that `InputError` names an unusable one before anything is written.

    cameras: a COLMAP model, a cameras.npz, or a folder of _cam.txt or .camera files; `ConfigError` where the
    photographs are not those of one folder.
    """
    known, warnings = None, list[str]()
    if cameras is not None:
        if len(images) != 1 or not os.path.isdir(images[0]):
            raise ConfigError("--cameras needs one folder of photographs")
        views = read_views(images[0], images[0], cameras, warnings)
        paths = [view.path for view in views]
        known = {name: view.camera for name, view in zip(distinct_names(paths), views, strict=True)}
    else:
        one_folder = len(images) == 1 and not os.path.isfile(images[0])
        paths = some_photographs(images[0]) if one_folder else list(images)
    for path in paths:
        read_image(path)
    return Inputs(paths, known, warnings)
