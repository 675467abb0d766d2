"""No function that opens a file is forgotten by the harness: each is run by the valid samples of some reader."""

import ast
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from readers import readers

import zpm2
from zpm2.evaluate.datasets import DATASETS
from zpm2.evaluate.results.registry import RESULTS

PACKAGE = Path(zpm2.__file__).parent
READING = ("read_bytes", "read_text", "read_json", "read_toml", "read_array", "read_arrays", "unpack_gzip", "regular")
OPENING = (  # of libraries, where they are given a path or its file
    *("open", "fdopen", "memmap", "fromfile", "loadtxt", "genfromtxt", "imread", "is_zipfile", "ZipFile"),
    *("Reconstruction", "infer_camera_from_image", "stereo_fusion", "poisson_meshing", "undistort_images"),
    *("patch_match_stereo", "extract_features", "read_model", "read_dataframe", "read_table", "connect"),
    "list_layers",
)
LIBRARIES = ("np", "json", "torch", "pickle", "trimesh", "PIL")
NOT_READ = {  # functions in which these names open what no user's file is, and what looks after that
    "control_groups.py: quota": "the kernel's, when the package is imported: tests/test_control_groups.py",
    "files/reading.py: unpack_gzip": "bytes",
    "export/colmap.py: write": "the photographs, which COLMAP reads in a temporary database of our own",
    "photos/shelf.py: get": "what this run itself wrote, in its own temporary folder",
    "view/report/assets.py: _text": "the package's own files",
    "cli/app.py: main": "nothing, where the output is full: tests/cli/test_app.py",
    "cli/view.py: view": "the browser",
    "cli/serve.py": "the browser; what it shows is opened by app/session.py",
    "app/export.py: archive": "what a result has just written",
    "app/server.py: __init__": "the package's own files",
    "files/keys.py: _code_in": "the source of the package and of plug-ins",
    "contract/formats.py": "what a format has just written",
    "features/vismatch_worker.py": "a pipe",
    "files/lock.py": "a file without content",
    "weights/": "downloads and verified files: tests/weights",
    "segment/sam_openvino.py": "networks of a folder that weights.converted has checked",
    "reconstruct/structure.py": "COLMAP's work on photographs that read_image has read: errors by io.colmap.colmap_can",
    "reconstruct/workspace.py: reconstruct": "the same",
    "reconstruct/workspace.py: _depth": "the same",
    "reconstruct/workspace.py: _fuse": "the same",
    "reconstruct/workspace.py: _mesh": "the same",
    "pose/colmap.py: _write_database": "a database that is written",
    "batch/results.py: save": "what a command has just written, on its way into a store",
    "formats/regions/labelme.py: _content": "a photograph that was read before, copied as it is",
    "formats/regions/labels.py: _tiff": "a file in memory that is written",
}


def opening() -> dict[str, int]:
    """The functions of the package that open files, "file: name" -> first line."""
    found = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        for function in ast.walk(ast.parse(file.read_text())):
            if isinstance(function, ast.FunctionDef) and any(_opens(node) for node in _own(function)):
                first = min([function.lineno, *(d.lineno for d in function.decorator_list)])
                found[f"{file.relative_to(PACKAGE).as_posix()}: {function.name}"] = first
    return found


def _own(function: ast.FunctionDef) -> list[ast.AST]:
    """What is in a function and in no function inside."""
    unread, nodes = list[ast.AST](function.body), []
    while unread:
        node = unread.pop()
        nodes.append(node)
        if not isinstance(node, ast.FunctionDef):
            unread += ast.iter_child_nodes(node)
    return nodes


def _opens(node: ast.AST) -> bool:
    if not isinstance(node, ast.Call):
        return False
    name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
    if name == "load":  # of a library, and not a method of ours
        holder = getattr(node.func, "value", None)
        return isinstance(holder, ast.Call) or (isinstance(holder, ast.Name) and holder.id in LIBRARIES)
    writes = name == "open" and any(isinstance(a, ast.Constant) and str(a.value)[:1] in "awx" for a in node.args)
    return name in READING + OPENING and bool(node.args or name == "open" or name in READING) and not writes


def known(name: str) -> bool:
    """Whether it is said why a function takes no part."""
    return any(name == each or (each.endswith(("/", ".py")) and name.startswith(each)) for each in NOT_READ)


@pytest.fixture(scope="module")
def called(tmp_path_factory: pytest.TempPathFactory) -> set[tuple[str, int]]:
    """File and first line of each function of the package that the valid samples run."""
    found = set[tuple[str, int]]()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            found.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))

    base = tmp_path_factory.mktemp("valid")
    for reader in readers():
        for k, sample in enumerate(reader.samples):
            for name, content in sample.items():
                path = base / reader.name / str(k) / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            sys.setprofile(note)
            try:
                reader.read(base / reader.name / str(k))
            finally:
                sys.setprofile(None)
    return {(str(Path(file).relative_to(PACKAGE)), line) for file, line in found if file.startswith(str(PACKAGE))}


def test_every_function_that_opens_a_file_is_reached(called: set[tuple[str, int]]) -> None:
    missing = [name for name, line in opening().items() if not known(name) and (name.split(":")[0], line) not in called]
    assert missing == []


def test_the_list_of_exceptions_holds_no_more_than_there_is() -> None:
    there = opening()
    assert [each for each in NOT_READ if not any(name.startswith(each) for name in there)] == []


def test_a_reader_is_there_for_every_data_set() -> None:
    assert {f"data set {name}" for name in DATASETS} <= {reader.name for reader in readers()}


def test_names_are_distinct() -> None:
    names = [reader.name for reader in readers()]
    assert len(set(names)) == len(names)


def test_a_reader_is_there_for_every_format_of_other_tools() -> None:
    assert {f"areas of other tools: {name}" for name in RESULTS} <= {reader.name for reader in readers()}
