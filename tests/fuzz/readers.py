"""Every function that reads a user's file, with small valid samples made by code."""

import json
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import PIL.Image
import rasterio
import trimesh
from app_readers import app_readers
from area_readers import area_readers
from batch_readers import batch_readers
from dataset_readers import dataset_readers
from mutate import SIZE
from own_readers import own_readers
from rasterio.rpc import RPC
from region_readers import region_readers
from samples import Files, Reader, encoded, npy, npz, only, pixels

from zpm2 import config
from zpm2.cloud.surface import SurfaceMesh
from zpm2.cloud.workspace import read_views
from zpm2.errors import MissingDependency
from zpm2.formats import cameras, colmap
from zpm2.formats.colmap_database import verified_pairs
from zpm2.formats.maps import read_disparity, read_map
from zpm2.formats.regions.registry import open_regions
from zpm2.formats.run_lengths import compressed
from zpm2.model import Image
from zpm2.photos import gdal
from zpm2.photos.images import read_image
from zpm2.photos.listing import image_size
from zpm2.photos.source import open_source
from zpm2.stereo.calibration import read_calibration
from zpm2.stereo.camera_check import orientation
from zpm2.stereo.intrinsics import from_exif, read_camera


def readers() -> list[Reader]:
    """All of them."""
    return [
        *(*_pictures(), *_regions(), *_tables(), *_cameras(), *_meshes()),
        *(*own_readers(), *dataset_readers(), *area_readers(), *app_readers(), *batch_readers()),
    ]


def _pictures() -> list[Reader]:
    exif = _exif(0x0112, 0x0110, 0x920A, 0xA405)
    photographs: tuple[Files, ...] = (
        {"a.png": encoded("PNG", pixels())},
        {"a.png": encoded("PNG", pixels(4))},
        {"a.png": cv2.imencode(".png", pixels(3, "u2"))[1].tobytes()},
        {"a.jpg": encoded("JPEG", pixels(), exif=exif.tobytes())},
        {"a.jpg": encoded("JPEG", pixels(), progressive=True)},
        {"a.tif": encoded("TIFF", pixels())},
        {"a.tif": encoded("TIFF", pixels(1, "f4"), compression="tiff_deflate")},
        {"a.tif": encoded("TIFF", pixels(1, "u2"), compression="tiff_lzw")},
        {"a.webp": encoded("WEBP", pixels(), lossless=True)},
        {"a.bmp": encoded("BMP", pixels())},
        {"a.jp2": cv2.imencode(".jp2", pixels())[1].tobytes()},
    )

    told: tuple[Files, ...] = (
        *(photographs[3], {"a.png": encoded("PNG", pixels(), exif=exif)}),
        {"a.jpg": encoded("JPEG", pixels(), exif=_exif(0x920A, 0x0110).tobytes())},
        {"a.jpg": encoded("JPEG", pixels(), exif=_exif(0x920A, 0xA20E, 0xA210, 0xA002).tobytes())},
    )

    def windows(folder: Path) -> None:
        path = min(folder.glob("a.*"), key=lambda path: len(path.name))  # and what lies beside it
        with closing(open_source(path)) as source:
            source.read((0, 0, source.width // 2, source.height // 2), (8, 8))
            source.to_lon_lat(np.zeros((2, 2)))

    still = frozenset(("b.tif",))
    mosaic = {"a.vrt": _VRT, "b.tif": photographs[5]["a.tif"]}
    reduced = encoded("TIFF", pixels()[::2, ::2])
    placed: tuple[Files, ...] = ({"a.tif": _placed()}, {"a.tif": _placed(rpc=True)})
    others: tuple[Files, ...] = (mosaic, {"a.tif.ovr": reduced, **photographs[5]}, {"a.tif.msk": reduced, **placed[0]})
    return [
        Reader("placed raster", (*placed, *others), windows, still),
        Reader("picture", photographs, lambda folder: read_image(only(folder))),
        Reader("picture by windows", photographs, windows),
        Reader("picture without rasterio", photographs, _without_rasterio(lambda folder: read_image(only(folder)))),
        Reader("size of a picture", photographs, lambda folder: (image_size(only(folder)), orientation(_text(folder)))),
        Reader("exif", told, lambda folder: from_exif(only(folder), SIZE)),
    ]


def _exif(*tags: int) -> PIL.Image.Exif:
    """Of these tags: orientation, make and model, focal lengths, resolution on the sensor and its unit, width."""
    top = {0x0112: 6, 0x010F: "Canon", 0x0110: "Canon EOS 5D"}
    below = {0x920A: 35.0, 0xA405: 50, 0xA20E: 200.0, 0xA210: 3, 0xA002: 48}
    exif = PIL.Image.Exif()
    for tag in tags:
        (exif if tag in top else exif.get_ifd(0x8769))[tag] = (top | below)[tag]
    return exif


def _without_rasterio(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """A reader where the extra `geo` is not installed."""

    def reading(folder: Path) -> Any:
        with mock.patch.object(gdal, "require_rasterio", side_effect=MissingDependency("no rasterio")):
            return read(folder)

    return reading


_VRT = b"""<VRTDataset rasterXSize="48" rasterYSize="40">
<SRS>EPSG:32632</SRS><GeoTransform>500000, 1, 0, 5000000, 0, -1</GeoTransform>
<VRTRasterBand dataType="Byte" band="1"><ColorInterp>Gray</ColorInterp><SimpleSource>
<SourceFilename relativeToVRT="1">b.tif</SourceFilename><SourceBand>1</SourceBand>
<SrcRect xOff="0" yOff="0" xSize="48" ySize="40"/><DstRect xOff="0" yOff="0" xSize="48" ySize="40"/>
</SimpleSource></VRTRasterBand></VRTDataset>
"""


def _placed(rpc: bool = False) -> bytes:
    """A GeoTIFF with a place on the ground, by a map or by rational polynomials."""
    line, sample = [0.0, 0, -1, *[0.0] * 17], [0.0, 1, *[0.0] * 18]
    one = [1.0, *[0.0] * 19]
    place: dict[str, Any] = {"crs": "EPSG:32632", "transform": rasterio.Affine(1, 0, 5e5, 0, -1, 5e6)}
    if rpc:
        place = {"rpcs": RPC(0, 1, 45, 1, one, line, 20, 20, 9, 1, one, sample, 24, 24)}
    with rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", width=SIZE[0], height=SIZE[1], count=1, dtype="uint8", **place) as file:
            file.write(pixels(1)[None])
        return memory.read()


def _regions() -> list[Reader]:
    image = Image(pixels(), "photo.png", ())
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
        {"a.png": encoded("PNG", labels)},
        {"a.tif": encoded("TIFF", labels)},
        {"a.npy": npy(labels)},
        {"a.geojson": json.dumps(geojson).encode()},
        {"a.json": json.dumps(coco).encode()},
        {"a.json": json.dumps(coco["annotations"][:2]).encode()},
    )
    read = lambda folder: open_regions(only(folder)).read(image)  # noqa: E731
    return [
        Reader("regions", samples, read),
        Reader("label image without rasterio", samples[:2], _without_rasterio(read)),
        *region_readers(),
    ]


def _tables() -> list[Reader]:
    values = np.linspace(1, 9, SIZE[0] * SIZE[1], dtype="f4").reshape(SIZE[::-1])
    maps: tuple[Files, ...] = (
        {"a.pfm": b"Pf\n%d %d\n-1.0\n" % SIZE + values.tobytes()},
        {"a.png": encoded("PNG", (values * 256).astype(np.uint16))},
        {"a.npy": npy(values)},
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
        Reader("map", maps, lambda folder: read_map(only(folder), SIZE)),
        Reader("disparity", maps, lambda folder: read_disparity(only(folder))),
        Reader(
            "configuration",
            ({"a.toml": toml}, {"a.json": json.dumps(stages).encode()}),
            lambda folder: config.load(only(folder)),
        ),
    ]


def _database() -> bytes:
    """Two images with verified matches."""
    with sqlite3.connect(":memory:") as database:
        database.execute("CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT)")
        database.execute("CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER)")
        database.executemany("INSERT INTO images VALUES (?, ?)", [(1, "a.png"), (2, "b.png")])
        database.execute("INSERT INTO two_view_geometries VALUES (?, 30)", (2147483647 + 2,))
        database.commit()
        return database.serialize()


def _cameras() -> list[Reader]:
    matrix = np.array([[50.0, 0, 24], [0, 50, 20], [0, 0, 1]])
    described = {"matrix": matrix.tolist(), "distortion": [0.1, 0.01], "width": SIZE[0], "height": SIZE[1]}
    photograph = {"a.png": encoded("PNG", pixels())}
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
            ({"K.txt": rows.encode()}, {"K.npy": npy(matrix)}, {"K.json": json.dumps(described).encode()}),
            lambda folder: read_camera(str(only(folder)), "a.png", SIZE),
        ),
        Reader(
            "COLMAP camera", ({**named}, {**binary}), lambda folder: read_camera(str(folder), folder / "a.png", SIZE)
        ),
        Reader("COLMAP poses", ({**named}, {**binary}), lambda folder: colmap.read_poses(folder, [])),
        Reader("COLMAP points", ({**named}, {**binary}), colmap.shared_points),
        Reader("COLMAP database", ({"a.db": _database()},), lambda folder: verified_pairs(only(folder))),
        Reader("workspace of COLMAP", ({**named, **two}, {**binary, **two}), views, still),
        Reader("workspace of IDR", ({"cameras.npz": npz(world), **two},), views, still),
        Reader("workspace of MVSNet", ({"a_cam.txt": mvsnet, "b_cam.txt": mvsnet, **two},), views, still),
        Reader("workspace of Strecha", ({"a.png.camera": strecha, "b.png.camera": strecha, **two},), views, still),
        Reader("calibration", ({"a.txt": middlebury}, {"a.txt": kitti}), lambda f: read_calibration(only(f), SIZE)),
        Reader(
            "archive", ({"a.npz": npz(world)},), lambda folder: cameras.idr(cameras.archive(only(folder)), 0, folder)
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
        {"a.stl": _exported("stl_ascii", points)},
        {"a.stl": _exported("stl", points)},
        {"a.glb": _exported("glb", points)},
    )
    return [Reader("mesh", samples, lambda folder: SurfaceMesh.read(only(folder)))]


def _exported(form: str, points: Any) -> bytes:
    content = trimesh.Trimesh(points, [[0, 1, 2], [0, 2, 3]], process=False).export(file_type=form)
    return content.encode() if isinstance(content, str) else content


def _text(folder: Path) -> str:
    return str(only(folder))
