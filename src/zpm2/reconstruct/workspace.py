"""Photographs in, a workspace out: images/, sparse/0, dense/, mesh.ply.

A step is skipped if its file exists and is usable. The result of a step is checked before it gets its name: if the next
step could not use it, it is not kept.
"""

import json
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType

from zpm2.config import Config, ReconstructConfig
from zpm2.errors import InputError
from zpm2.files.keys import code, stamp
from zpm2.files.listing import distinct_names, json_file
from zpm2.files.record import make_folder, move_into_place, temporary_folder
from zpm2.files.writing import atomic_write, claim
from zpm2.formats.colmap import colmap_can, open_model, require_pycolmap
from zpm2.formats.meshes import read_mesh
from zpm2.model import PosedCamera
from zpm2.reconstruct.depth import write_depth_maps
from zpm2.reconstruct.photographs import as_png
from zpm2.reconstruct.structure import find_structure
from zpm2.stereo.dense import stereo_matcher

POINT_BYTES = 27  # of a point in COLMAP's PLY: coordinates and normal as float32, colour
HEADER_BYTES = 2000  # more than that PLY has before its points
ADVICE = "give photographs that overlap more, or a larger --max-size, and another folder"
IMAGES, CLAIM = "images", "reconstruct.json"
NAMES = (CLAIM, "sparse", "dense", "fused.ply", "mesh.ply")  # beside the photographs


@dataclass(frozen=True)
class Reconstruction:
    """How much of the photographs a reconstruction used."""

    registered: int  # photographs with a camera
    photographs: int
    points: int  # of the fused cloud
    notes: tuple[str, ...]


def reconstruct(
    photographs: Sequence[Path],
    workspace: Path,
    config: Config,
    known: Mapping[str, PosedCamera] | None = None,
    tell: Callable[[str, float], None] = lambda stage, share: None,
) -> Reconstruction:
    """Reconstruct a workspace from photographs, or go on where an earlier run of the same was interrupted.

    Photographs of one name in two folders keep their sub-folders (`files.listing.distinct_names`); those that lie in
    the workspace's own images/ are used where they are.

    config: its stages `reconstruct` and `stereo`. known: cameras by these names, if they are known. Structure from
    motion, undistortion, fusion and Poisson meshing are COLMAP's (pycolmap, the extra `colmap`). Depth is COLMAP's
    PatchMatch where its build has CUDA, else dense stereo of rectified neighbours (`stereo.method`), of which several
    must agree.
    `InputError` where the photographs are not connected or give no surface, or the workspace is another
    reconstruction's; `OutputError` where a file in it that no reconstruction made has one of its names.
    """
    pycolmap, own = require_pycolmap(), config.reconstruct
    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR
    names = distinct_names(photographs)
    if len(names) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"there are {len(names)} photographs with {len(set(names))} names: give at least two, all named differently"
        )
    if not pycolmap.has_cuda:
        stereo_matcher(config.stereo, config.device)  # what it lacks is said before the work, not after half of it
    _claim(workspace, photographs, config, known)
    images = workspace / IMAGES
    if not _in_place(photographs, images):
        _link(photographs, names, make_folder(images))
    tell("structure", 0.0)
    model = find_structure(images, names, workspace, known, config)
    tell("structure", 1.0)
    registered = open_model(model).num_reg_images()
    dense = workspace / "dense"
    if not (dense / "sparse" / "cameras.bin").is_file():
        undistort = pycolmap.UndistortCameraOptions()
        undistort.max_image_size = own.max_size
        with temporary_folder(workspace) as part:
            with colmap_can(f"undistort the photographs in {images}"):
                pycolmap.undistort_images(part / "dense", model, images, undistort_options=undistort)
            made = sum(path.is_file() for path in (part / "dense" / IMAGES).rglob("*"))
            if made < registered:
                raise InputError(f"COLMAP undistorted only {made} of {registered} photographs: check {images}")
            move_into_place(part / "dense", dense)
    notes = _depth(pycolmap, dense, config, tell)
    fused = workspace / "fused.ply"
    if _points(fused) < own.min_fused_points:
        tell("fusion", 0.0)
        _fuse(pycolmap, dense, fused, own)
        tell("fusion", 1.0)
    points, mesh = _points(fused), workspace / "mesh.ply"
    if not _has_faces(mesh):
        tell("mesh", 0.0)
        _mesh(pycolmap, fused, mesh, own)
        tell("mesh", 1.0)
    if registered < len(names):
        notes.append(f"{len(names) - registered} of {len(names)} photographs could not be oriented")
    return Reconstruction(registered, len(names), points, tuple(notes))


def claimed_names(workspace: Path, photographs: Sequence[Path]) -> list[str]:
    """The files and folders that a reconstruction of these photographs makes in its workspace."""
    return [*NAMES, *([] if _in_place(photographs, workspace / IMAGES) else [IMAGES])]


def _claim(
    workspace: Path, photographs: Sequence[Path], config: Config, known: Mapping[str, PosedCamera] | None
) -> None:
    """Makes a folder the workspace of these photographs, or goes on in it."""
    file = claim(workspace, claimed_names(workspace, photographs)) / CLAIM
    mine = {
        "photographs": {name: stamp(path) for name, path in zip(distinct_names(photographs), photographs, strict=True)},
        "options": {"reconstruct": asdict(config.reconstruct), "stereo": asdict(config.stereo)},
        "cameras": None if known is None else {name: _values(camera) for name, camera in known.items()},
        "code": code(),
    }
    if not file.is_file():
        atomic_write(file, json.dumps(mine, indent=1))
        return
    theirs = json_file(file)
    if not isinstance(theirs, dict):
        raise InputError(f"{file} is damaged: give another folder")
    differ = [name for name, value in json.loads(json.dumps(mine)).items() if theirs.get(name) != value]
    if differ:
        raise InputError(f"{workspace} is a reconstruction with other {' and '.join(differ)}: give another folder")


def _values(posed: PosedCamera) -> list[object]:
    return [posed.camera.to_dict(), posed.rotation.tolist(), posed.translation.tolist()]


def _in_place(photographs: Sequence[Path], images: Path) -> bool:
    names = distinct_names(photographs)
    return all(path.resolve() == (images / name).resolve() for path, name in zip(photographs, names, strict=True))


def _link(photographs: Sequence[Path], names: Sequence[str], folder: Path) -> None:
    """The photographs in the workspace: hard links, copies where the file system has none; as PNG where COLMAP does
    not read the same pixels."""
    for path, name in zip(photographs, names, strict=True):
        target = folder / name
        for parent in reversed(Path(name).parents[:-1]):
            make_folder(folder / parent)
        if not target.exists():
            pixels = as_png(path)
            if pixels is not None:
                atomic_write(target, pixels)
                continue
            try:
                os.link(path.resolve(), target)
            except OSError:
                with temporary_folder(folder) as part:
                    shutil.copyfile(path, part / "photograph")
                    move_into_place(part / "photograph", target)


def _depth(pycolmap: ModuleType, dense: Path, config: Config, tell: Callable[[str, float], None]) -> list[str]:
    if not pycolmap.has_cuda:
        return write_depth_maps(dense, config, tell)
    tell("depth", 0.0)
    with colmap_can(f"compute depth in {dense}"):
        pycolmap.patch_match_stereo(dense)
    tell("depth", 1.0)
    return []


def _fuse(pycolmap: ModuleType, dense: Path, fused: Path, config: ReconstructConfig) -> None:
    views = sum(1 for _ in (dense / "stereo" / "depth_maps").rglob("*.geometric.bin"))
    options = pycolmap.StereoFusionOptions()
    options.min_num_pixels = min(config.fusion_views, views)
    options.num_threads = 1  # several would race for the points
    if not pycolmap.has_cuda:
        options.max_normal_error = config.fusion_angle
    with temporary_folder(fused.parent) as part:
        made = part / fused.name
        with colmap_can(f"fuse the depth maps in {dense}"):
            pycolmap.stereo_fusion(made, dense, options=options, output_type="PLY")
        points = _points(made)
        if points < config.min_fused_points:
            raise InputError(f"the views agree on the depth of {points} points: too few for a surface; {ADVICE}")
        move_into_place(made, fused)


def _mesh(pycolmap: ModuleType, fused: Path, mesh: Path, config: ReconstructConfig) -> None:
    meshing = pycolmap.PoissonMeshingOptions()
    meshing.depth, meshing.trim = config.poisson_depth, config.trim
    meshing.num_threads = 1  # several add up in another order each time
    with temporary_folder(mesh.parent) as part:
        made = part / mesh.name
        with colmap_can(f"make a surface of {fused}"):
            pycolmap.poisson_meshing(fused, made, meshing)
        if not _has_faces(made):
            points = _points(fused)
            raise InputError(f"the {points} points lie too far apart for a surface: no triangle is left; {ADVICE}")
        move_into_place(made, mesh)


def _points(fused: Path) -> int:
    """How many points a PLY of COLMAP's fusion holds; 0 where there is none, or it is cut short."""
    if not fused.is_file():
        return 0
    with fused.open("rb") as file:
        found = re.search(rb"^element vertex (\d{1,18})$", file.read(HEADER_BYTES), re.MULTILINE)
    number = int(found[1]) if found is not None else 0
    return number if fused.stat().st_size > number * POINT_BYTES else 0


def _has_faces(mesh: Path) -> bool:
    """Whether a file is there and a mesh, whole and with faces."""
    try:
        return any(len(part) for part in read_mesh(mesh)[1])
    except (OSError, ValueError):
        return False
