"""Mesh files of every kind hold the same faces; what is cut short says so."""

from pathlib import Path

import numpy as np
import pytest

from zpm2.formats.meshes import read_mesh

VERTICES = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0.5], [1, 1, 0], [1, 2, 0], [0, 2, -0.25]])
MIXED = [[0, 1, 2], [0, 1, 2, 3], [5, 3, 4], [0, 1, 2, 3, 4, 5], [3, 4, 5, 0]]
QUADS = [[0, 1, 2, 3], [3, 4, 5, 0]]


def header(form: str, faces: list[list[int]]) -> bytes:
    lines = [
        "ply",
        f"format {form} 1.0",
        "comment made by a test",
        f"element vertex {len(VERTICES)}",
        *(
            f"property {kind} {name}"
            for kind, name in (("double", "x"), ("uchar", "red"), ("float", "y"), ("float32", "z"))
        ),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "property list uchar float texcoord",
        "property uchar flags",
        "end_header",
    ]
    return "\n".join(lines).encode() + b"\n"


def ply(faces: list[list[int]], order: str) -> bytes:
    content = header("binary_little_endian" if order == "<" else "binary_big_endian", faces)
    for x, y, z in VERTICES:
        content += np.array([x], order + "f8").tobytes() + b"\x07" + np.array([y, z], order + "f4").tobytes()
    for face in faces:
        content += bytes([len(face)]) + np.array(face, order + "i4").tobytes()
        content += bytes([2]) + np.zeros(2, order + "f4").tobytes() + b"\x01"
    return content


def ascii_ply(faces: list[list[int]], newline: str = "\n") -> bytes:
    lines = [f"{x} 7 {y} {z}" for x, y, z in VERTICES]
    lines += [" ".join(map(str, [len(face), *face, 2, 0.5, 0.5, 1])) for face in faces]
    return (header("ascii", faces).decode() + "\n".join(lines) + "\n").replace("\n", newline).encode()


def obj(faces: list[list[int]]) -> bytes:
    lines = [
        "# a test",
        "mtllib none.mtl",
        *(f"v {x} {y} {z} 0.5 0.5 0.5" for x, y, z in VERTICES),
        "vt 0 0",
        "vn 0 0 1",
    ]
    lines += [
        "f " + " ".join(f"{k + 1}/1/1" if n % 2 else f"{k - len(VERTICES)}//1" for k in f) for n, f in enumerate(faces)
    ]
    return "\r\n".join([*lines, "v 9 9 9"]).encode()


def off(faces: list[list[int]]) -> bytes:
    lines = [
        "COFF # a test",
        "",
        f"{len(VERTICES)} {len(faces)} 0",
        *(f"{x} {y} {z} 255 0 0 1" for x, y, z in VERTICES),
    ]
    return "\n".join([*lines, *(" ".join(map(str, [len(f), *f, 255, 0, 0])) for f in faces)]).encode()


FILES = {
    "little.ply": lambda faces: ply(faces, "<"),
    "big.ply": lambda faces: ply(faces, ">"),
    "text.ply": ascii_ply,
    "windows.ply": lambda faces: ascii_ply(faces, "\r\n"),
    "mesh.obj": obj,
    "mesh.off": off,
}


@pytest.mark.parametrize("faces", [MIXED, QUADS, MIXED[:1], MIXED[3:4]])
@pytest.mark.parametrize("name", FILES)
def test_what_was_written_comes_back(name: str, faces: list[list[int]], tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(FILES[name](faces))
    vertices, found = read_mesh(tmp_path / name)
    assert np.array_equal(vertices[: len(VERTICES)], VERTICES)
    assert sorted(face for part in found for face in part.tolist()) == sorted(faces)


@pytest.mark.parametrize("name", ["little.ply", "big.ply", "text.ply", "mesh.off"])
@pytest.mark.parametrize("faces", [MIXED, QUADS])
def test_files_that_are_cut_short(name: str, faces: list[list[int]], tmp_path: Path) -> None:
    content = FILES[name](faces)
    for share in (0.5, 0.8) if name == "mesh.off" else (0.5, 0.8, 0.97):  # its last numbers are colours
        (tmp_path / name).write_bytes(content[: int(share * len(content)) - 1])
        with pytest.raises(ValueError, match=r"cut short|no PLY header|fewer than three numbers"):
            read_mesh(tmp_path / name)


def test_files_that_are_none(tmp_path: Path) -> None:
    for name, content, why in (
        ("a.ply", b"no mesh", "no PLY header"),
        ("b.ply", ply([[0, 1, 9]], "<"), "vertices that it does not have"),
        ("c.obj", obj([[0, 1, 2], [0, 1, 9]]), "vertices that it does not have"),
        ("d.off", b"", "no OFF header"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match=why):
            read_mesh(tmp_path / name)
