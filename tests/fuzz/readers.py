"""Every function that reads a user's file, with small valid samples made by code."""

import gzip
import io
import json
import struct
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image
from mutate import SIZE

from zpm2 import config
from zpm2.cloud.stereo import read_calibration
from zpm2.cloud.surface import Surface
from zpm2.cloud.workspace import read_views
from zpm2.detect.region_files import open_regions
from zpm2.evaluate import predictions
from zpm2.evaluate.datasets import dtu, isprs, pair_list, scannet, scannet1500
from zpm2.evaluate.pairs import EvalPair
from zpm2.io import cameras, colmap, files, record
from zpm2.io.coco import compressed
from zpm2.io.fit import orientation
from zpm2.io.images import read_image
from zpm2.io.inputs import image_size
from zpm2.io.maps import read_disparity, read_map
from zpm2.io.source import open_source
from zpm2.model import Image
from zpm2.pose.intrinsics import read_camera
from zpm2.result import MatchResult
from zpm2.tiled.tile import Kept

Files = dict[str, bytes]


@dataclass(frozen=True)
class Reader:
    """A function of a folder, and folders that it reads: files by name, the first of each is damaged most."""

    name: str
    samples: tuple[Files, ...]
    read: Callable[[Path], Any]
    still: frozenset[str] = frozenset()  # names of files that stay as they are


def readers() -> list[Reader]:
    """All of them."""
    return [*_pictures(), *_regions(), *_tables(), *_cameras(), *_meshes(), *_results(), *_datasets()]


def _pixels(bands: int = 3, kind: str = "u1") -> Any:
    rng = np.random.default_rng(0)
    values = rng.integers(0, 255 if kind == "u1" else 4000, (SIZE[1], SIZE[0], bands)).astype(kind)
    return values[..., 0] if bands == 1 else values


def _encoded(kind: str, pixels: Any, **options: Any) -> bytes:
    out = io.BytesIO()
    PIL.Image.fromarray(pixels).save(out, kind, **options)
    return out.getvalue()


def _pictures() -> list[Reader]:
    exif = PIL.Image.Exif()
    exif[0x0112], exif[0x0110] = 6, "camera"
    exif.get_ifd(0x8769)[0x920A], exif.get_ifd(0x8769)[0xA405] = 35.0, 50
    photographs: tuple[Files, ...] = (
        {"a.png": _encoded("PNG", _pixels())},
        {"a.png": _encoded("PNG", _pixels(4))},
        {"a.png": cv2.imencode(".png", _pixels(3, "u2"))[1].tobytes()},
        {"a.jpg": _encoded("JPEG", _pixels(), exif=exif.tobytes())},
        {"a.jpg": _encoded("JPEG", _pixels(), progressive=True)},
        {"a.tif": _encoded("TIFF", _pixels())},
        {"a.tif": _encoded("TIFF", _pixels(1, "f4"), compression="tiff_deflate")},
        {"a.tif": _encoded("TIFF", _pixels(1, "u2"), compression="tiff_lzw")},
        {"a.webp": _encoded("WEBP", _pixels(), lossless=True)},
        {"a.bmp": _encoded("BMP", _pixels())},
        {"a.jp2": cv2.imencode(".jp2", _pixels())[1].tobytes()},
    )

    told: tuple[Files, ...] = (photographs[3], {"a.png": _encoded("PNG", _pixels(), exif=exif)})

    def windows(folder: Path) -> None:
        with closing(open_source(_only(folder))) as source:
            source.read((0, 0, source.width // 2, source.height // 2), (8, 8))
            source.to_lon_lat(np.zeros((2, 2)))

    return [
        Reader("picture", photographs, lambda folder: read_image(_only(folder))),
        Reader("picture by windows", photographs, windows),
        Reader(
            "size of a picture", photographs, lambda folder: (image_size(_only(folder)), orientation(_text(folder)))
        ),
        Reader("exif", told, lambda folder: read_camera("exif", _only(folder), SIZE)),
    ]


def _regions() -> list[Reader]:
    image = Image(_pixels(), "photo.png", ())
    labels = np.zeros(SIZE[::-1], np.uint16)
    labels[5:20, 5:30], labels[25:35, 10:40] = 1, 2
    ring = [[5, 5], [30, 5], [30, 20], [5, 20], [5, 5]]
    geojson = {
        "type": "FeatureCollection",
        "image": {"name": "photo.png", "width": SIZE[0], "height": SIZE[1]},
        "features": [
            {
                "type": "Feature",
                "id": 1,
                "properties": {"score": 0.9, "label": "roof"},
                "geometry": {"type": "Polygon", "coordinates": [ring, [[8, 8], [12, 8], [12, 12]]]},
            },
            {
                "type": "Feature",
                "properties": {"fid": 2},
                "geometry": {"type": "MultiPolygon", "coordinates": [[ring]]},
            },
        ],
    }
    runs = [200, 100, SIZE[0] * SIZE[1] - 300]
    coco = {
        "images": [{"id": 1, "file_name": "photo.png", "width": SIZE[0], "height": SIZE[1]}],
        "categories": [{"id": 1, "name": "roof"}],
        "annotations": [
            {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [[5, 5, 30, 5, 30, 20]], "score": 0.5},
            {"id": 2, "image_id": 1, "category_id": 1, "segmentation": {"size": [40, 48], "counts": runs}},
            {
                "id": 3,
                "image_id": 1,
                "segmentation": {"size": [40, 48], "counts": compressed(np.array(runs))},
                "predicted_iou": 1.0,
            },
        ],
    }
    samples: tuple[Files, ...] = (
        {"a.png": _encoded("PNG", labels)},
        {"a.tif": _encoded("TIFF", labels)},
        {"a.npy": _npy(labels)},
        {"a.geojson": json.dumps(geojson).encode()},
        {"a.json": json.dumps(coco).encode()},
        {"a.json": json.dumps(coco["annotations"][:2]).encode()},
    )
    return [Reader("regions", samples, lambda folder: open_regions(_only(folder))(image))]


def _tables() -> list[Reader]:
    values = np.linspace(1, 9, SIZE[0] * SIZE[1], dtype="f4").reshape(SIZE[::-1])
    maps: tuple[Files, ...] = (
        {"a.pfm": b"Pf\n%d %d\n-1.0\n" % SIZE + values.tobytes()},
        {"a.png": _encoded("PNG", (values * 256).astype(np.uint16))},
        {"a.npy": _npy(values)},
    )
    toml = (
        b'seed = 3\n[segment]\ngrid = 16\nquality = "fast"\n[points]\nmethods = ["sift"]\n[raster]\nbands = [1, 2, 3]\n'
    )
    stages = {
        "seed": 3,
        "segment": {"grid": 16, "nms_iou": 0.7},
        "points": {"methods": ["sift"]},
        "raster": {"gsd": [1]},
    }
    return [
        Reader("map", maps, lambda folder: read_map(_only(folder), SIZE)),
        Reader("disparity", maps, lambda folder: read_disparity(_only(folder))),
        Reader(
            "configuration",
            ({"a.toml": toml}, {"a.json": json.dumps(stages).encode()}),
            lambda folder: config.load(_only(folder)),
        ),
    ]


def _cameras() -> list[Reader]:
    matrix = np.array([[50.0, 0, 24], [0, 50, 20], [0, 0, 1]])
    described = {"matrix": matrix.tolist(), "distortion": [0.1, 0.01], "width": SIZE[0], "height": SIZE[1]}
    photograph = {"a.png": _encoded("PNG", _pixels())}
    rows = "\n".join(" ".join(map(str, row)) for row in matrix)
    named = {
        "cameras.txt": b"# list\n1 PINHOLE 48 40 50 50 24 20\n2 OPENCV 48 40 50 50 24 20 .1 0 0 0\n",
        "images.txt": b"1 1 0 0 0 0 0 0 1 a.png\n1 2 -1\n2 1 0 0 0 1 0 0 2 b.png\n\n",
    }
    binary = {
        "cameras.bin": struct.pack("<QIiQQ4d", 1, 1, 1, 48, 40, 50, 50, 24, 20),
        "images.bin": struct.pack("<Q", 2)
        + b"".join(
            struct.pack("<I7dI", k, 1, 0, 0, 0, k, 0, 0, 1) + name + struct.pack("<Q2dq", 1, 3, 4, -1)
            for k, name in ((1, b"a.png\0"), (2, b"b.png\0"))
        ),
    }
    two = {**photograph, "b.png": photograph["a.png"]}
    world = {f"world_mat_{k}": np.vstack([np.c_[matrix, [k, 0, 5]], [0, 0, 0, 1]]) for k in range(2)}
    mvsnet = b"extrinsic\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n50 0 24\n0 50 20\n0 0 1\n\n1 2\n"
    strecha = f"{rows}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 2 3\n48 40\n".encode()
    middlebury = (
        b"cam0=[50 0 24; 0 50 20; 0 0 1]\ncam1=[50 0 26; 0 50 20; 0 0 1]\ndoffs=2\nbaseline=100\nwidth=48\nheight=40\n"
    )
    kitti = b"P0: 50 0 24 0 0 50 20 0 0 0 1 0\nP2: 50 0 24 0 0 50 20 0 0 0 1 0\nP3: 50 0 24 -25 0 50 20 0 0 0 1 0\n"
    views = lambda folder: read_views(folder, notes=[])  # noqa: E731
    still = frozenset(two)
    return [
        Reader(
            "K",
            ({"K.txt": rows.encode()}, {"K.npy": _npy(matrix)}, {"K.json": json.dumps(described).encode()}),
            lambda folder: read_camera(str(_only(folder)), "a.png", SIZE),
        ),
        Reader(
            "COLMAP camera", ({**named}, {**binary}), lambda folder: read_camera(str(folder), folder / "a.png", SIZE)
        ),
        Reader("COLMAP poses", ({**named}, {**binary}), lambda folder: colmap.read_poses(folder, [])),
        Reader("workspace of COLMAP", ({**named, **two}, {**binary, **two}), views, still),
        Reader("workspace of IDR", ({"cameras.npz": _npz(world), **two},), views, still),
        Reader("workspace of MVSNet", ({"a_cam.txt": mvsnet, "b_cam.txt": mvsnet, **two},), views, still),
        Reader("workspace of Strecha", ({"a.png.camera": strecha, "b.png.camera": strecha, **two},), views, still),
        Reader("calibration", ({"a.txt": middlebury}, {"a.txt": kitti}), lambda f: read_calibration(_only(f), SIZE)),
        Reader(
            "archive", ({"a.npz": _npz(world)},), lambda folder: cameras.idr(cameras.archive(_only(folder)), 0, folder)
        ),
    ]


def _meshes() -> list[Reader]:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 2, 1]], "<f4")
    faces = [(0, 1, 2), (0, 2, 3), (1, 2, 4, 3)]
    head = "ply\nformat {}\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n" + (
        "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    )
    lines = [" ".join(map(str, point)) for point in points.tolist()]
    listed = [" ".join(map(str, (len(face), *face))) for face in faces]
    packed = b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    obj = [f"v {line}" for line in lines] + ["f " + " ".join(f"{k + 1}/1" for k in face) for face in faces]
    samples: tuple[Files, ...] = (
        {"a.ply": (head.format("ascii 1.0") + "\n".join(lines + listed) + "\n").encode()},
        {"a.ply": head.format("binary_little_endian 1.0").encode() + points.tobytes() + packed},
        {"a.obj": "\n".join(obj).encode()},
        {"a.off": "\n".join(["OFF", "5 3 0", *lines, *listed]).encode()},
    )
    return [Reader("mesh", samples, lambda folder: Surface.read(_only(folder)))]


def _results() -> list[Reader]:
    square = [[5.0, 5.0], [30.0, 5.0], [30.0, 20.0], [5.0, 20.0]]
    polygon = {"id": 1, "vertices": square, "holes": [], "area": 375.0, "score": 0.9, "parent": None, "label": "a"}
    side = {"path": None, "width": 48, "height": 40, "crs": None, "transform": [[1, 0, 0], [0, 1, 0]], "gsd": 1.0}
    side |= {"rpc": None, "polygons": [polygon, {**polygon, "id": 2, "unmatched": "rejected"}]}
    points = {"left": [[1.0, 2.0], [3.0, 4.0]], "right": [[1.0, 2.0], [3.0, 4.0]], "score": [1.0, 0.5]}
    match = {"left": 1, "right": 1, "confidence": 0.5, "cost": 0.1, "dsf": 0.2, "stage": "reference", "overlap": None}
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
    made = b'{"format": "zpm2-folder/1"}\n{"name": "overlay.png", "is": "12-ab"}\n{"name": "images", "is": "folder"}\n'
    pair = EvalPair("pair", Path("a.png"), Path("b.png"))

    def predicted(folder: Path) -> None:
        predictions.load(pair, folder)
        predictions.load_pose(pair, folder)
        predictions.memory(pair, folder)
        predictions.is_of(pair, folder)

    def recorded(folder: Path) -> None:
        hidden = folder / record.HIDDEN
        hidden.mkdir(exist_ok=True)
        (folder / record.RECORD).replace(hidden / record.RECORD)
        files.claim(folder, ["images", "matches.json"])
        record.kept(folder)
        record.unmark(folder)

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
    return [
        Reader("result", ({"matches.json": written},), lambda folder: MatchResult.load(folder)),
        Reader("predictions", (kept, {"predictions/pair/failed.json": b'{"reason": "why"}', **kept}), predicted),
        Reader("tile", ({"a.json.gz": gzip.compress(json.dumps(tile).encode())},), _tile),
        Reader("record", ({record.RECORD: made, "overlay.png": b"x"},), recorded),
    ]


def _tile(folder: Path) -> None:
    Kept(folder.parent, folder.name).load("a", ((0, 0, 48, 40), (0, 0, 48, 40)))


def _datasets() -> list[Reader]:
    picture = _encoded("PNG", _pixels())
    two = {"a.png": picture, "b.png": picture}
    eye, k = np.eye(4).tolist(), [[50, 0, 24], [0, 50, 20], [0, 0, 1]]
    listed = [
        {"name": "one", "left": "a.png", "right": "b.png", "gt": {"kind": "disparity", "file": "a.png", "scale": 256}},
        {"name": "two", "left": "a.png", "right": "b.png", "set": "x", "gt": {"kind": "homography", "H": k}},
        {"name": "3", "left": "a.png", "right": "b.png", "gt": {"kind": "pose", "K0": k, "K1": k, "T_0to1": eye}},
    ]
    csv = b"left,right,disparity,scale,sign,name\na.png,b.png,a.png,256,1,first\na.png,b.png,,,,\n"
    scene = {f"color/{n}.png": picture for n in (0, 20)}
    poses = {f"pose/{n}.txt": "\n".join(" ".join(map(str, row)) for row in eye).encode() for n in (0, 20)}
    calibration = {"intrinsic/intrinsic_color.txt": b"50 0 24 0\n0 50 20 0\n0 0 1 0\n0 0 0 1\n"}
    index = {"name": np.array([[707, 0, 0, 20]]), "rel_pose": np.eye(4)[:3].reshape(1, 12)}
    colour = {f"scans_test/scene0707_00/color/{n}.jpg": _encoded("JPEG", _pixels()) for n in (0, 20)}
    cams = b"extrinsic\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n50 0 24\n0 50 20\n0 0 1\n\n1 2\n"
    views = {f"images/0000000{n}.png": picture for n in (0, 1)}
    neighbours = {
        "pair.txt": b"2\n0\n1 1 2.5\n1\n1 0 2.5\n",
        "cams/00000000_cam.txt": cams,
        "cams/00000001_cam.txt": cams,
    }
    return [
        Reader(
            "pairs.json",
            ({"pairs.json": json.dumps(listed).encode(), **two},),
            lambda folder: list(pair_list.from_json(folder, None)),
            frozenset(two),
        ),
        Reader("pairs.csv", ({"pairs.csv": csv, **two},), lambda f: list(pair_list.from_csv(f, None)), frozenset(two)),
        Reader(
            "pairs.txt", ({"pairs.txt": b"a.png b.png\n", **two},), lambda f: list(isprs.pairs(f, None)), frozenset(two)
        ),
        Reader(
            "ScanNet", ({**poses, **calibration, **scene},), lambda f: list(scannet.pairs(f, None)), frozenset(scene)
        ),
        Reader(
            "ScanNet1500",
            ({"test.npz": _npz(index), "intrinsics.npz": _npz({"scene0707_00": np.array(k, float)}), **colour},),
            lambda folder: list(scannet1500.pairs(folder, None)),
            frozenset(colour),
        ),
        Reader("DTU", ({**neighbours, **views},), lambda folder: list(dtu.pairs(folder, None)), frozenset(views)),
    ]


def _npy(values: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, values)
    return out.getvalue()


def _npz(values: dict[str, Any]) -> bytes:
    out = io.BytesIO()
    np.savez(out, **values)
    return out.getvalue()


def _only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def _text(folder: Path) -> str:
    return str(_only(folder))
