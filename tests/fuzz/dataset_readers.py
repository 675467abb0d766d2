"""Data sets in their publishers' layouts, as readers: every pair listed, and its truth read."""

import json
from pathlib import Path

import numpy as np
import PIL.Image
from mutate import SIZE
from samples import Files, Reader, encoded, npz, pixels

from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.ground_truth import covisible
from zpm2.evaluate.pairs import DepthTruth, DisparityTruth, HomographyTruth
from zpm2.photos.listing import image_size

PICTURE = encoded("PNG", pixels())
CALIBRATION = [[50, 0, 24], [0, 50, 20], [0, 0, 1]]
VALUES = np.linspace(1, 9, SIZE[0] * SIZE[1], dtype="f4").reshape(SIZE[::-1])
DISPARITY = encoded("PNG", (VALUES * 256).astype(np.uint16))
PFM = b"Pf\n%d %d\n-1.0\n" % SIZE + VALUES.tobytes()
CAMERA = b"extrinsic\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n50 0 24\n0 50 20\n0 0 1\n\n1 2\n"


def dataset_readers() -> list[Reader]:
    """One of each data set that can be opened by name."""
    return [_reader(name, *samples) for name, samples in _samples().items()]


def _reader(name: str, *samples: Files) -> Reader:
    """Pictures are damaged by other readers; here it is what lies beside them."""

    def read(folder: Path) -> None:
        for pair in open_dataset(name, folder).pairs():
            if isinstance(pair.truth, DisparityTruth | DepthTruth | HomographyTruth):
                covisible(pair.truth, image_size(pair.left), image_size(pair.right))

    still = frozenset(path for sample in samples for path, content in sample.items() if content in (PICTURE, SMALL))
    return Reader(f"data set {name}", samples, read, still)


def _painted(width: int, height: int) -> bytes:
    return encoded("PNG", np.asarray(PIL.Image.fromarray(pixels()).resize((width, height))))


SMALL = _painted(48, 370)  # as high as the photographs of 2006 at a third of their size


def _samples() -> dict[str, tuple[Files, ...]]:
    two, eye = {"a.png": PICTURE, "b.png": PICTURE}, np.eye(4).tolist()
    listed = [
        {"name": "one", "left": "a.png", "right": "b.png", "gt": {"kind": "disparity", "file": "d.png", "scale": 256}},
        {"name": "two", "left": "a.png", "right": "b.png", "set": "x", "gt": {"kind": "homography", "H": np.eye(3)}},
        {"name": "3", "left": "a.png", "right": "b.png", "gt": {"kind": "pose", "T_0to1": eye}},
        {"name": "4", "left": "a.png", "right": "b.png", "gt": {"kind": "depth", "T_0to1": eye, "file": "d.png"}},
    ]
    listed[1]["gt"]["H"] = np.eye(3).tolist()  # type: ignore[index]
    for entry in listed[2:]:
        entry["gt"] |= {"K0": CALIBRATION, "K1": CALIBRATION}  # type: ignore[operator]
    csv = b"left,right,disparity,scale,sign,name\na.png,b.png,d.png,256,1,first\na.png,b.png,,,,\n"
    poses = {f"pose/{n}.txt": "\n".join(" ".join(map(str, row)) for row in eye).encode() for n in (0, 20)}
    video = {f"color/{n}.png": PICTURE for n in (0, 20)}
    depth = {f"depth/{n}.png": DISPARITY for n in (0, 20)}
    calibration = b"50 0 24 0\n0 50 20 0\n0 0 1 0\n0 0 0 1\n"
    colour = {f"scans_test/scene0707_00/color/{n}.jpg": PICTURE for n in (0, 20)}
    index = npz({"name": np.array([[707, 0, 0, 20]]), "rel_pose": np.eye(4)[:3].reshape(1, 12)})
    numbers = " ".join(str(value) for value in [0, 0, *np.ravel(CALIBRATION), *np.ravel(CALIBRATION), *np.ravel(eye)])
    frames = " ".join(f"scans_test/scene0707_00/color/{n}.jpg" for n in (0, 20))
    views = {f"images/0000000{n}.png": PICTURE for n in (0, 1)}
    cameras = {f"cams/0000000{n}_cam.txt": CAMERA for n in (0, 1)}
    world = {f"world_mat_{k}": np.vstack([np.c_[CALIBRATION, [k, 0, 5]], [0, 0, 0, 1]]) for k in range(2)}
    kitti = {"training/disp_occ/000000_10.png": DISPARITY}
    kitti |= {f"training/colored_{n}/000000_10.png": PICTURE for n in (0, 1)}
    kitti_2015 = {"training/disp_occ_0/000000_10.png": DISPARITY}
    kitti_2015 |= {f"training/image_{n}/000000_10.png": PICTURE for n in (2, 3)}
    things = {"disparity/TRAIN/A/0000/left/0006.pfm": PFM}
    things |= {f"frames_cleanpass/TRAIN/A/0000/{side}/0006.png": PICTURE for side in ("left", "right")}
    eth = {"two_view_training_gt/yard/disp0GT.pfm": PFM}
    eth |= {f"two_view_training/yard/im{n}.png": PICTURE for n in (0, 1)}
    of_2006 = encoded("PNG", np.full((370, 48), 12, np.uint8))
    return {
        "pairs": ({"pairs.json": json.dumps(listed).encode(), "d.png": DISPARITY, **two},),
        "csv": ({"pairs.csv": csv, "d.png": DISPARITY, **two},),
        "isprs": ({"pairs.txt": b"a.png b.png\n", **two},),
        "scannet": (
            {**poses, "intrinsic/intrinsic_color.txt": calibration, **video},
            {**poses, "intrinsic/intrinsic_depth.txt": calibration, **depth, **video},
        ),
        "scannet1500": (
            {"test.npz": index, "intrinsics.npz": npz({"scene0707_00": np.array(CALIBRATION, float)}), **colour},
            {"scannet_test_pairs_with_gt.txt": f"{frames} {numbers}\n".encode(), **colour},
        ),
        "dtu": (
            {"pair.txt": b"2\n0\n1 1 2.5\n1\n1 0 2.5\n", **cameras, **views},
            {"cameras.npz": npz(world), **{f"image/00000{n}.png": PICTURE for n in (0, 1)}},
        ),
        "kitti2012": (kitti,),
        "kitti2015": (kitti_2015,),
        "sceneflow": (things,),
        "eth3d": (eth,),
        "middlebury": (
            {"Adirondack/disp0.pfm": PFM, **{f"Adirondack/im{n}.png": PICTURE for n in (0, 1)}},
            {"Aloe/disp1.png": of_2006, **{f"Aloe/view{n}.png": SMALL for n in (1, 5)}},
        ),
    }
