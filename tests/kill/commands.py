"""The commands that write files, with small inputs made by code, and those that write none."""

import json
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path += [str(TESTS / name) for name in (".", "weights", "evaluate", "linking") if str(TESTS / name) not in sys.path]

import boards  # noqa: E402
import loopback  # noqa: E402
import numpy as np  # noqa: E402
import towns  # noqa: E402
from rendered import Pair, save_pair  # noqa: E402

READ_ONLY = ("doctor", "config list", "config show", "weights list", "models", "bench")
READ_ONLY += ("view",)  # one missing page at most
READ_ONLY += ("app",)  # its results leave it through the browser
POINTS = ("--set", "points.methods=sift", "--device", "cpu")  # no network for points
FEW = ("--set", "segment.grid=8")  # prompts


@dataclass(frozen=True)
class Case:
    """A command line that writes into the folder `out`, with inputs in the folder `../in`.

    networks: whether it segments, which takes seconds and the weights. needs: packages.
    """

    name: str
    words: list[str]
    networks: bool = False
    needs: tuple[str, ...] = ()
    code: int = 0
    environment: dict[str, str] = field(default_factory=dict)


@contextmanager
def cases(folder: Path, ready: bool = True) -> Iterator[list[Case]]:
    """All of them; `folder` gets the inputs, as `in`, of all of them or, if not `ready`, of matching and of weights."""
    from zpm2.evaluate.rendered import render_scene

    inputs = folder / "in"
    inputs.mkdir(parents=True)
    pair = save_pair(render_scene(0, 400, 240), inputs)
    town = towns.houses(60)
    (inputs / "pairs.csv").write_text("left,right\nleft.png,right.png\nright.png,left.png\n")
    towns.write(inputs / "before.geojson", town)
    towns.write(inputs / "after.geojson", towns.moved(town, (3.0, 2.0), 2.0))
    if ready:
        _evaluation(pair, inputs)
        boards.write(inputs / "boards", 4)
    with loopback.serve() as server:
        server.files["/owner/models/resolve/main/tiny.pt"] = loopback.CONTENT
        (inputs / "weights").mkdir()
        (inputs / "weights" / "tiny.pt").write_bytes(loopback.CONTENT)
        cache = {"ZPM2_CACHE": "out", "ZPM2_WEIGHTS": "", "ZPM2_OFFLINE": "", "HF_HUB_OFFLINE": ""}
        cache |= {"HF_ENDPOINT": server.address, "NO_PROXY": "127.0.0.1"}
        yield [*_cases(pair), *(Case(name, [*name.split(), *more], environment=cache) for name, more in WEIGHTS)]


OWN = ("tiny", "--weights-dir", "../in/weights")
WEIGHTS = (("weights get", ("tiny",)), ("weights verify", OWN), ("weights path", OWN))


def _cases(pair: Pair) -> Iterator[Case]:
    scene = pair.scene
    photographs = ["../in/left.png", "../in/right.png"]
    regions = ["--left-regions", "../in/left_labels.png", "--right-regions", "../in/right_labels.png"]
    own = ["--segmenter", "precomputed", *regions, "--points", "sift", "--device", "cpu"]
    camera = f"{scene.f},{scene.f},{scene.cx},{scene.cy}"
    rig = ["--stereo", "--K", camera, "--baseline", "0.2"]
    known = ["--matches", "../in/matches"]
    out = ["-o", "out", "-q"]
    formats = [word for name in ("gpkg", "shapefile", "geoparquet", "coco") for word in ("--format", name)]
    tiles = ["--tiles", "on", "--set", "tiles.size=256"]
    data = ["eval", "pairs", "--root", "../in"]
    yield Case("match", ["match", *photographs, *own, *formats, "--outlines", *out], needs=("pyogrio", "pyarrow"))
    yield Case("match in tiles", ["match", *photographs, *own, *tiles, *out])
    yield Case("match, found regions", ["match", *photographs, *POINTS, *FEW, *out], networks=True)
    yield Case("match, default", ["match", *photographs, *out], networks=True)
    yield Case("match, found regions in tiles", ["match", *photographs, *POINTS, *FEW, *tiles, *out], networks=True)
    carried = ["carry", *photographs, "--regions", "../in/left_labels.png", "--rigid"]
    yield Case("carry", [*carried, "--set", "points.methods=sift", *out])
    yield Case("link", ["link", "../in/before.geojson", "../in/after.geojson", *out], needs=("rasterio", "pyogrio"))
    simple = ["--segmenter", "classical", "--set", "guided.direction=off", "--set", "segment.detail.level=off"]
    followed = ["tracks", *photographs, "--pairs", "sequential", *simple, *POINTS, *out]
    yield Case("tracks", [*followed, "--set", "points.escalate.on=false"])
    many = ["batch", "../in/pairs.csv", *simple, *POINTS, "--workers", "2", *out]
    yield Case("batch", [*many, "--set", "points.escalate.on=false"], needs=("pyarrow",))
    more = ["--rectify", "--colmap"]
    yield Case("pose", ["pose", *photographs, *known, "--K", camera, *POINTS, *more, *out], needs=("pycolmap",))
    yield Case("pose, matched", ["pose", *photographs, "--K", camera, *POINTS, *FEW, *out], networks=True)
    lifted = ["cloud", *photographs, *rig, "--spacing", "0.05"]
    yield Case("cloud --stereo", [*lifted, *known, *POINTS, "--las", *out], needs=("trimesh", "laspy"))
    yield Case("cloud --stereo, matched", [*lifted, *POINTS, *FEW, *out], networks=True, needs=("trimesh",))
    workspace = ["cloud", "../in/workspace", *POINTS, *FEW, *out]
    yield Case("cloud", workspace, networks=True, needs=("trimesh",))
    yield Case("export", ["export", "../in/matches", *out], needs=("pycolmap",))
    yield Case("export to hloc", ["export", "../in/matches", "--to", "hloc", *out], needs=("h5py",))
    kept = ["--regions", "../in/predictions", "--set", "points.methods=sift"]
    yield Case("eval", [*data, *kept, "--parquet", *out], needs=("pyarrow",))
    yield Case("eval, a baseline", [*data, "--method", "shape-context", "--regions", "../in/predictions", *out])
    yield Case("demo", ["demo", *POINTS, *FEW, *out], networks=True)
    yield Case("reconstruct", ["reconstruct", "../in/boards", "--max-size", "480", *out], needs=("pycolmap", "trimesh"))


def _evaluation(pair: Pair, folder: Path) -> None:
    """Predictions of given regions as `zpm2 eval` keeps them, a data set that takes their regions, the matches alone,
    and a workspace of the pair with the surface that it shows."""
    from zpm2.cloud.disparity_mesh import disparity_mesh
    from zpm2.cloud.export import write_surface
    from zpm2.config import CloudConfig, assign, preset
    from zpm2.evaluate import predictions
    from zpm2.evaluate.datasets import open_dataset
    from zpm2.model import Camera
    from zpm2.pipeline import PairMatcher
    from zpm2.segment.given.precomputed import PrecomputedSegmenter
    from zpm2.stereo.rig import Rig

    scene = pair.scene
    matrix = np.array([[scene.f, 0, scene.cx], [0, scene.f, scene.cy], [0, 0, 1]])
    np.save(folder / "disparity.npy", scene.disparity.astype(np.float32))
    step = np.eye(4)
    step[0, 3] = -scene.baseline
    poses = {"kind": "pose", "K0": matrix.tolist(), "K1": matrix.tolist(), "T_0to1": step.tolist()}
    truths = {"a": {"kind": "disparity", "file": "disparity.npy"}, "b": poses, "c": None}
    entries = [{"name": n, "left": "left.png", "right": "right.png", "gt": truth} for n, truth in truths.items()]
    entries.append({"name": "d", "left": "text.png", "right": "right.png", "gt": None})
    (folder / "text.png").write_text("no picture")
    (folder / "pairs.json").write_text(json.dumps(entries))
    sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    matcher = PairMatcher(assign(preset("default"), ["points.methods=sift", "device=cpu"]), segmenter=sides)
    result = matcher(pair.left, pair.right)
    result.save(folder / "matches")
    predictions.PredictionSettings("pairs", None, "zpm2", {}).claim(folder / "predictions")
    pairs = list(open_dataset("pairs", folder).pairs())
    predictions.predict(pairs, lambda: lambda asked: matcher(asked.left, asked.right), folder / "predictions", _mute)

    workspace = folder / "workspace"
    (workspace / "images").mkdir(parents=True)
    for path in (pair.left, pair.right):
        shutil.copy(path, workspace / "images")
    camera = Camera(matrix, (400, 240))
    surface = disparity_mesh(scene.disparity, Rig(camera, camera, scene.baseline), CloudConfig())
    write_surface(surface, workspace / "mesh.ply")

    model = workspace / "sparse" / "0"
    model.mkdir(parents=True)
    numbers = f"{scene.f} {scene.f} {scene.cx} {scene.cy}"
    (model / "cameras.txt").write_text(f"1 PINHOLE 400 240 {numbers}\n")
    turn = "1 0 0 0"
    lines = [f"1 {turn} 0 0 0 1 left.png", "", f"2 {turn} {-scene.baseline} 0 0 1 right.png", ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    (model / "points3D.txt").write_text("")


def _mute(text: str) -> None:
    pass


def names_of_commands() -> list[str]:
    """All of the command line."""
    import typer

    from zpm2.cli.app import app

    def walk(group: object, before: tuple[str, ...] = ()) -> Iterator[str]:
        for name, command in group.commands.items():  # type: ignore[attr-defined]
            words = (*before, name)
            if hasattr(command, "commands"):
                yield from walk(command, words)
            else:
                yield " ".join(words)

    return sorted(walk(typer.main.get_command(app)))
