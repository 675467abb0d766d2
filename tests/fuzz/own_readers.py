"""What zpm2 wrote itself and reads again: results, caches, records, all of which others can damage or forge."""

import dataclasses
import gzip
import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from mutate import SIZE
from samples import Files, Reader, encoded, only, pixels

from zpm2.carry.result import Side
from zpm2.config import Config
from zpm2.evaluate import predicted_regions, predictions
from zpm2.evaluate.overview import save_overview
from zpm2.evaluate.pairs import EvalPair
from zpm2.evaluate.speed import SCHEMA, PairSpeed, Speed
from zpm2.files import record, writing
from zpm2.files.keys import code, fingerprint
from zpm2.formats import colmap
from zpm2.formats.masks import RegionMask, write_masks
from zpm2.model import Camera, PointMatches, Polygon, PolygonArrays
from zpm2.reconstruct import workspace
from zpm2.reconstruct.depth import read_sparse
from zpm2.result import MatchResult
from zpm2.tiled.tile import TileCache
from zpm2.tracking.events import events
from zpm2.tracking.matches import PairMatches, Store
from zpm2.weights import converted, licence, store
from zpm2.weights.manifest import Entry


def own_readers() -> list[Reader]:
    """All of them."""
    return [*_results(), *_folders(), *_weights()]


def _results() -> list[Reader]:
    square = [[5.0, 5.0], [30.0, 5.0], [30.0, 20.0], [5.0, 20.0]]
    polygon = {"id": 1, "vertices": square, "holes": [], "area": 375.0, "score": 0.9, "parent": None, "label": "a"}
    side = {"path": None, "width": 48, "height": 40, "crs": None, "transform": [[1, 0, 0], [0, 1, 0]], "gsd": 1.0}
    side |= {"rpc": None, "polygons": [polygon, {**polygon, "id": 2, "unmatched": "rejected"}]}
    points = {"left": [[1.0, 2.0], [3.0, 4.0]], "right": [[1.0, 2.0], [3.0, 4.0]], "score": [1.0, 0.5]}
    match = {"left": 1, "right": 1, "confidence": 0.5, "cost": 0.1, "dsf": 2, "stage": "local", "overlap": 0.5}
    document = {
        "schema": "zpm2-matches/1",
        "left": side,
        "right": side,
        "matches": [{**match, "nodes": [[0, 0], [1, 1]]}],
        "points": points,
        "fundamental": None,
        "homography": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "config": {"local_match": {"gamma": 3}},
        "timings": {"points": 1.0},
        "warnings": [],
        "version": "0",
    }
    tile = {
        "level": 0,
        "sides": [{**side, "window": [0, 0, 48, 40]}] * 2,
        "guided": [[1, 1]],
        "points": points,
        "seconds": {"points": 1},
    }
    pair_of_tracks = {"left": [polygon], "right": [polygon], "confidence": [0.9], "points": points}
    pair_of_tracks |= {"homography": np.eye(3).tolist(), "warnings": ["a"], "notes": []}
    pair = EvalPair("pair", Path("a.png"), Path("b.png"))

    def predicted(folder: Path) -> None:
        predictions.load(pair, folder)
        predictions.load_pose(pair, folder)
        predictions.memory(pair, folder)
        predictions.is_current(pair, folder)

    pose = {
        "pose": {"rotation": np.eye(3).tolist(), "translation": [1, 0, 0], "flags": ["planar"]},
        "counts": {"used": 10, "inliers": 8},
        "timings": {"pose": 0.1},
    }
    written = json.dumps(document).encode()
    kept = {
        "predictions/pair/matches.json": written,
        "predictions/pair/pose.json": json.dumps(pose).encode(),
        "predictions/pair/memory.json": b'{"peak_mb": 100}',
    }
    below = {
        "rows.csv": b"pair,F1,good\na,0.5,3\n",
        "predictions/a/matches.json": written,
        "predictions/a/overlay.png": encoded("PNG", pixels()),
    }
    return [
        Reader("result", ({"matches.json": written},), lambda folder: MatchResult.load(folder)),
        Reader("predictions", (kept, {"predictions/pair/failed.json": b'{"reason": "why"}', **kept}), predicted),
        Reader("pair of tracks", ({"a.json.gz": gzip.compress(json.dumps(pair_of_tracks).encode())},), _pair_of_tracks),
        Reader(
            "report of a bench", ({"a.json": json.dumps(_bench()).encode()},), lambda folder: Speed.load(only(folder))
        ),
        Reader("cameras of Nerfstudio", ({"transforms.json": NERFSTUDIO},), _masks),
        Reader(
            "results below a folder", (below, {"a/failed.json": b'{"reason": "why"}'}), lambda f: save_overview(f, 0)
        ),
        Reader("tile", ({"a.json.gz": gzip.compress(json.dumps(tile).encode())},), _tile),
    ]


def _tile(folder: Path) -> None:
    path = only(folder)
    TileCache(path.parent.parent, path.parent.name).load("a", ((0, 0, 48, 40), (0, 0, 48, 40)))


NERFSTUDIO = json.dumps({"fl_x": 1.0, "frames": [{"file_path": "images/a.png", "transform_matrix": [[1.0]]}]}).encode()


def _masks(folder: Path) -> None:
    write_masks(folder / "masks", ["nerfstudio"], [RegionMask(Side(str(folder / "a.png"), 48, 40), [])], True)


def _bench() -> dict[str, object]:
    seconds = {"points": 0.5, "total": 1.0}
    one = PairSpeed("a - b", "48 x 40 px", 3, seconds, seconds)
    return {"schema": SCHEMA, **dataclasses.asdict(Speed({"device": "cpu"}, {"seed": 0}, 2, [one], None, 100, None))}


def _pair_of_tracks(folder: Path) -> None:
    nothing = PairMatches([], [], np.zeros(0), PointMatches.empty(), None, [], [])
    found = Store(only(folder).parent).get("a", PairMatches, lambda: nothing)
    zip(found.left, found.right, found.confidence, strict=True)
    PolygonArrays(found.left)
    seen = {0: {polygon.id: polygon for polygon in found.left}, 1: dict[int, Polygon]()}
    events(seen, (0, 1), found, Config().tracks, Config().local_match)


def _folders() -> list[Reader]:
    """Output folders that a run goes on in."""
    run = predictions.PredictionSettings("pairs", None, "zpm2", {"seed": 0})
    config = Config()
    options = {"reconstruct": vars(config.reconstruct), "stereo": vars(config.stereo)}
    claimed = {"photographs": {}, "options": options, "cameras": None, "code": code()}
    points = 100
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nend_header\n" % points
    model = _model()
    made = b'{"format": "zpm2-folder/1"}\n{"name": "overlay.png", "is": "12-ab"}\n{"name": "images", "is": "folder"}\n'
    made_model = _made(model)
    hidden = f"{record.HIDDEN}/{record.RECORD}"

    def recorded(folder: Path) -> None:
        writing.claim(folder, ["images", "matches.json"])
        record.saved_key(folder)
        record.remove_record(folder)

    def evaluation(folder: Path) -> None:
        _remember(folder)
        run.claim(folder)
        predicted_regions.PredictedRegions(folder)

    def claim(folder: Path) -> None:
        _remember(folder)
        workspace._claim(folder, [], config, None)

    return [
        Reader("record", ({hidden: made, f"{record.KEYS}/key": b"ab", "overlay.png": b"x"},), recorded),
        Reader("run of an evaluation", ({"run.json": json.dumps(vars(run)).encode()},), evaluation),
        Reader("claim of a reconstruction", ({"reconstruct.json": json.dumps(claimed).encode()},), claim),
        Reader(
            "points of a reconstruction",
            ({"fused.ply": header + bytes(points * workspace.POINT_BYTES + 1)},),
            lambda folder: workspace._points(only(folder)),
        ),
        Reader("model of a reconstruction", ({**model, hidden: made_model},), lambda folder: read_sparse(folder / "0")),
    ]


def _made(content: Files) -> bytes:
    """A record of these files."""
    with tempfile.TemporaryDirectory() as base:
        for name, data in content.items():
            Path(base, name).parent.mkdir(exist_ok=True)
            Path(base, name).write_bytes(data)
        _remember(Path(base))
        return Path(base, record.HIDDEN, record.RECORD).read_bytes()


def _remember(folder: Path) -> None:
    """Puts what is in a folder on record, as if a run had written it."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    named = [{"name": path.relative_to(folder).as_posix(), "is": fingerprint(path)} for path in paths]
    (folder / record.HIDDEN).mkdir()
    lines = [json.dumps(line) + "\n" for line in (record.FORMAT, *named)]
    (folder / record.HIDDEN / record.RECORD).write_text("".join(lines))


def _model() -> Files:
    """A model as pycolmap writes it: two views of one point."""
    pycolmap = colmap.require_pycolmap()
    model = pycolmap.Reconstruction()
    for key, name in enumerate("ab", 1):
        model.add_camera_with_trivial_rig(colmap.to_pycolmap(Camera(np.diag([50.0, 50, 1]), SIZE), key))
        image = pycolmap.Image(name=f"{name}.png", image_id=key, camera_id=key)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D([1.0, 2.0])])
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(np.eye(3, 4)))
    track = pycolmap.Track([pycolmap.TrackElement(1, 0), pycolmap.TrackElement(2, 0)])
    model.add_point3D(np.array([0.0, 0, 1]), track)
    with tempfile.TemporaryDirectory() as base:
        model.write_binary(base)
        return {f"0/{path.name}": path.read_bytes() for path in sorted(Path(base).iterdir())}


def _weights() -> list[Reader]:
    """The cache of weights, of which every file but the weights themselves is only a note."""
    content = b"weights"
    item = Entry("a", "a.bin", len(content), hashlib.sha256(content).hexdigest(), "free", "", "", ())
    bound = Entry("b", "b.bin", 1, "", "not for all", "", "", (), terms="the terms")
    marker = {"path": "/a.bin", "size": len(content), "mtime_ns": 0, "sha256": item.sha256}
    listed = {"mask.bin": [1, hashlib.sha256(b"x").hexdigest()]}
    made = "weights/converted/mobile_sam-key"

    def convert(folder: Path) -> None:
        (folder / "mask.bin").write_bytes(b"x")

    def cached(folder: Path, ask: Any) -> None:
        with mock.patch.dict(os.environ, ZPM2_CACHE=str(folder), ZPM2_WEIGHTS=""):
            ask()

    return [
        Reader(
            "marker of weights",
            ({"weights/a.bin.verified.json": json.dumps(marker).encode(), "weights/a.bin": content},),
            lambda folder: cached(folder, lambda: store.find(item)),
        ),
        Reader(
            "accepted licences",
            ({"weights/accepted-licences.txt": b"not for all\n"},),
            lambda folder: cached(folder, lambda: licence.require(bound)),
        ),
        Reader(
            "converted networks",
            ({f"{made}/files.json": json.dumps(listed).encode(), f"{made}/mask.bin": b"x"},),
            lambda folder: cached(folder, lambda: converted("mobile_sam", "key", convert)),
        ),
    ]
