"""Photographs in, a workspace out: images/, sparse/0, dense/, mesh.ply. A step whose file is there is skipped."""

import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from zpm2.errors import InputError
from zpm2.io.colmap import require_pycolmap
from zpm2.io.files import atomic_write, output_folder
from zpm2.model import PosedCamera
from zpm2.reconstruct.depth import write_depth_maps
from zpm2.reconstruct.photographs import as_png
from zpm2.reconstruct.structure import find_structure


@dataclass(frozen=True)
class Options:
    """Numbers of a reconstruction."""

    max_size: int = 1600  # px, the longer side of the images that depth is computed on
    neighbors: int = 3  # views that the depth of each view is computed from
    ordered: bool = False  # the photographs are a sequence
    poisson_depth: int = 11  # of the octree (Kazhdan and Hoppe 2013)
    trim: float = 8.0  # octree depth of the sampling under which the surface is cut away


@dataclass(frozen=True)
class Reconstructed:
    """What a reconstruction gave."""

    registered: int  # photographs with a camera
    photographs: int
    points: int  # of the fused cloud
    notes: tuple[str, ...]


def reconstruct(
    photographs: Sequence[Path],
    workspace: Path,
    options: Options,
    known: Mapping[str, PosedCamera] | None = None,
    tell: Callable[[str, float], None] = lambda stage, share: None,
) -> Reconstructed:
    """Reconstruct a workspace from photographs, or go on where an earlier run of the same was interrupted.

    known: cameras by file name, if they are known. Structure from motion, undistortion, fusion and Poisson meshing are
    COLMAP's (pycolmap, the extra `colmap`); depth is its PatchMatch where its build has CUDA and a GPU is there, else
    semi-global matching of rectified neighbours, of which at least two must agree. `InputError` where the photographs
    do not hang together, or the workspace is another reconstruction's.
    """
    pycolmap = require_pycolmap()
    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR
    names = [path.name for path in photographs]
    if len(names) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"there are {len(names)} photographs with {len(set(names))} names: give at least two, all named differently"
        )
    _claim(workspace, photographs, options, known is not None)
    _link(photographs, workspace / "images")
    tell("structure", 0.0)
    model = find_structure(workspace / "images", names, workspace, known, options.ordered)
    tell("structure", 1.0)
    dense = workspace / "dense"
    if not (dense / "sparse" / "cameras.bin").is_file():
        part = workspace / "dense.part"
        shutil.rmtree(part, ignore_errors=True)
        undistort = pycolmap.UndistortCameraOptions()
        undistort.max_image_size = options.max_size
        pycolmap.undistort_images(part, model, workspace / "images", undistort_options=undistort)
        part.rename(dense)
    notes = _depth(pycolmap, dense, options, tell)
    fused = workspace / "fused.ply"
    if not fused.is_file():
        tell("fusion", 0.0)
        _fuse(pycolmap, dense, fused)
        tell("fusion", 1.0)
    points = _vertices(fused)
    if points < 100:
        raise InputError(f"the views agree on the depth of {points} points only: there is no surface to make")
    mesh = workspace / "mesh.ply"
    if not mesh.is_file():
        tell("mesh", 0.0)
        part = workspace / "mesh.part.ply"
        meshing = pycolmap.PoissonMeshingOptions()
        meshing.depth, meshing.trim = options.poisson_depth, options.trim
        pycolmap.poisson_meshing(fused, part, meshing)
        if not part.is_file():
            raise InputError(f"Poisson meshing of {fused} gave no surface")
        part.rename(mesh)
        tell("mesh", 1.0)
    registered = pycolmap.Reconstruction(str(model)).num_reg_images()
    if registered < len(names):
        notes.append(f"{len(names) - registered} of {len(names)} photographs could not be oriented")
    return Reconstructed(registered, len(names), points, tuple(notes))


def _claim(workspace: Path, photographs: Sequence[Path], options: Options, known: bool) -> None:
    """Makes a folder the workspace of these photographs, or goes on in it."""
    file = output_folder(workspace) / "reconstruct.json"
    mine = {"photographs": [str(p.resolve()) for p in photographs], "options": asdict(options), "cameras_known": known}
    if not file.is_file():
        atomic_write(file, json.dumps(mine, indent=1))
        return
    theirs = json.loads(file.read_text(encoding="utf-8"))
    differ = [name for name in mine if theirs.get(name) != mine[name]]
    if differ:
        raise InputError(f"{workspace} is a reconstruction with other {' and '.join(differ)}: give another folder")


def _link(photographs: Sequence[Path], folder: Path) -> None:
    """The photographs in the workspace: hard links, copies where the file system has none; as PNG what COLMAP does not
    read as we do."""
    folder.mkdir(exist_ok=True)
    for path in photographs:
        if not (folder / path.name).exists():
            pixels = as_png(path)
            if pixels is not None:
                atomic_write(folder / path.name, pixels)
                continue
            try:
                os.link(path.resolve(), folder / path.name)
            except OSError:
                shutil.copyfile(path, folder / path.name)


def _depth(pycolmap: Any, dense: Path, options: Options, tell: Callable[[str, float], None]) -> list[str]:
    if not pycolmap.has_cuda:
        return write_depth_maps(dense, options.neighbors, tell)
    tell("depth", 0.0)
    pycolmap.patch_match_stereo(dense)
    tell("depth", 1.0)
    return []


def _fuse(pycolmap: Any, dense: Path, fused: Path) -> None:
    views = sum(1 for _ in (dense / "stereo" / "depth_maps").glob("*.geometric.bin"))
    options = pycolmap.StereoFusionOptions()
    options.min_num_pixels = min(3, views)
    if not pycolmap.has_cuda:
        options.max_normal_error = 40.0  # normals come from differences of depth here, and are noisier
    part = fused.with_suffix(".part.ply")
    pycolmap.stereo_fusion(part, dense, options=options, output_type="PLY")
    part.with_name(f"{part.name}.vis").unlink(missing_ok=True)
    part.rename(fused)


def _vertices(ply: Path) -> int:
    """The number of vertices that the header of a PLY names."""
    with ply.open("rb") as file:
        for line in file:
            if line.startswith(b"element vertex"):
                return int(line.split()[2])
            if line.startswith(b"end_header"):
                break
    return 0
