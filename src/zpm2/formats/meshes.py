"""Meshes from PLY, OBJ and OFF files as stored: vertices, and faces with any number of corners."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.files.reading import read_bytes

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Polygons = list[Indices]  # (m, k) each: m faces with k corners

CUT = "it is cut short: copy or download it again"
_KINDS = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_LISTS = ("vertex_indices", "vertex_index")
_Property = tuple[str, str, str]  # name, type, and for a list the type of its length, else ""
_Element = tuple[str, int, list[_Property]]  # name, how many, of what


def read_mesh(path: Path) -> tuple[Array, Polygons]:
    """(n, 3) vertices and the faces of a .ply (text or binary of either byte order), .obj or .off file.

    `ValueError` for another format, a file that is cut short, and faces with vertices that do not exist. `OSError`
    where the file cannot be read.
    """
    read = {".ply": _ply, ".obj": _obj, ".off": _off}[path.suffix.lower()]
    vertices, faces = read(read_bytes(path))
    if any(len(part) and (part.min() < 0 or part.max() >= len(vertices)) for part in faces):
        raise ValueError("its faces name vertices that it does not have: export it again")
    return vertices, faces


def _ply(content: bytes) -> tuple[Array, Polygons]:
    header = re.search(rb"\n[ \t\r]*end_header[ \t]*\r?\n", content)
    if header is None or not re.match(rb"ply\s", content):
        raise ValueError("it has no PLY header")
    form, elements = _header(content[: header.end()].decode("latin-1"))
    buffer, place = content, header.end()
    if form == "ascii":  # converted to binary, all numbers as doubles
        buffer, place = np.array(content[header.end() :].split(), np.float64).tobytes(), 0
        elements = [
            (n, count, [(p, "=f8", length and "=f8") for p, _, length in props]) for n, count, props in elements
        ]
    coordinates: list[Array] = []
    faces: Polygons = []
    for name, count, properties in elements:
        place, places = _places(buffer, place, count, properties)
        kinds = {p: (kind, length) for p, kind, length in properties}
        if name == "vertex":
            coordinates = [_values(buffer, places[axis], kinds[axis][0]).astype(np.float64) for axis in "xyz"]
        for listed in _LISTS:
            if name == "face" and listed in kinds:
                faces += _lists(buffer, places[listed], *kinds[listed])
        if name == "tristrips":
            raise ValueError("it holds triangle strips: export it with triangles")
    if not coordinates:
        raise ValueError("it has no vertices")
    return np.stack(coordinates, axis=1), faces


def _header(text: str) -> tuple[str, list[_Element]]:
    form, order, elements = "", "=", list[_Element]()
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1]
            order = ">" if form == "binary_big_endian" else "<"
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            length = order + _KINDS[words[2]] if words[1] == "list" else ""
            elements[-1][2].append((words[-1], order + _KINDS[words[-2]], length))
    return form, elements


def _places(buffer: bytes, start: int, count: int, properties: Sequence[_Property]) -> tuple[int, dict[str, Indices]]:
    """Where an element ends, and where each record has each property (a list: its length), in bytes."""
    sizes = [(np.dtype(kind).itemsize, length) for _, kind, length in properties]
    end, offsets = _record(buffer, start, sizes) if count else (start, [start] * len(sizes))
    stride = end - start
    rows = np.arange(count, dtype=np.int64) * stride
    if start + stride * count <= len(buffer):
        places = [offset + rows for offset in offsets]
        lengths = [_values(buffer, at, length) for at, (_, length) in zip(places, sizes, strict=True) if length]
        if all((one == one[:1]).all() for one in lengths):
            return start + stride * count, dict(zip((p[0] for p in properties), places, strict=True))
    found = []
    for _ in range(count):  # lists of different lengths: each record tells where the next one starts
        start, offsets = _record(buffer, start, sizes)
        found.append(offsets)
    return start, dict(zip((p[0] for p in properties), np.array(found, np.int64).T, strict=True))


def _record(buffer: bytes, start: int, sizes: Sequence[tuple[int, str]]) -> tuple[int, list[int]]:
    """Where a record ends and where it has each property, in bytes."""
    offsets = []
    for size, length in sizes:
        offsets.append(start)
        if length:
            width = np.dtype(length).itemsize
            if start + width > len(buffer):
                raise ValueError(CUT)
            (number,) = struct.unpack_from(length[0] + np.dtype(length).char, buffer, start)
            start += width + int(number) * size
        else:
            start += size
    if start > len(buffer):
        raise ValueError(CUT)
    return start, offsets


def _values(buffer: bytes, places: Indices, kind: str) -> NDArray[np.number]:
    """(n,) the numbers of type `kind` that begin at `places`, in bytes."""
    size = np.dtype(kind).itemsize
    if len(places) and (places[0] < 0 or places[-1] + size > len(buffer)):
        raise ValueError(CUT)
    step = int(places[1] - places[0]) if len(places) > 1 else size
    if (np.diff(places) == step).all():
        return np.ndarray((len(places),), kind, buffer, int(places[0]) if len(places) else 0, (step,)).copy()
    return np.frombuffer(buffer, np.uint8)[places[:, None] + np.arange(size)].view(kind)[:, 0]


def _lists(buffer: bytes, places: Indices, kind: str, length: str) -> Polygons:
    lengths = _whole(_values(buffer, places, length))
    first, size = np.dtype(length).itemsize, np.dtype(kind).itemsize
    return [
        _whole(np.stack([_values(buffer, places[lengths == k] + first + j * size, kind) for j in range(k)], axis=1))
        for k in np.unique(lengths).tolist()
        if k > 0
    ]


def _obj(content: bytes) -> tuple[Array, Polygons]:
    text = content.decode("utf-8", "replace").replace("\\\r\n", " ").replace("\\\n", " ")
    lines = [line for line in map(str.strip, text.split("\n")) if line[:2] in ("v ", "f ", "v\t", "f\t")]
    is_vertex = np.array([line[0] == "v" for line in lines], bool)
    before = np.cumsum(is_vertex)[~is_vertex]  # number of vertices so far: negative indices count back from it
    corners = re.sub(r"/\S*|#.*", "", "\n".join(line[2:] for line in lines if line[0] == "f"))
    numbers, lengths = _numbers(corners.split("\n") if len(before) else [])
    return _points(*_numbers([line[2:] for line in lines if line[0] == "v"])), [
        np.where(part < 0, part + before[rows, None], part - 1)
        for rows, part in _by_length(numbers, np.cumsum(lengths) - lengths, lengths)
    ]


def _off(content: bytes) -> tuple[Array, Polygons]:
    text = re.sub(r"#.*", "", content.decode("utf-8", "replace"))
    lines = [line for line in map(str.strip, text.split("\n")) if line]
    head = lines[0].split() if lines else []
    if not head or not re.fullmatch(r"(ST|C|N)*OFF", head[0]):
        raise ValueError("it has no OFF header")
    lines = ([" ".join(head[1:])] if head[1:] else []) + lines[1:]
    n, m = (int(word) for word in lines[0].split()[:2])
    vertices = _points(*_numbers(lines[1 : 1 + n]))
    numbers, lengths = _numbers(lines[1 + n : 1 + n + m])
    starts = np.cumsum(lengths) - lengths
    corners = _whole(numbers[starts])  # of a face; its colour may follow
    if len(vertices) < n or len(lengths) < m or (corners >= lengths).any():
        raise ValueError(CUT)
    return vertices, [part for _, part in _by_length(numbers, starts + 1, corners)]


def _numbers(lines: Sequence[str]) -> tuple[Array, Indices]:
    """All numbers of the lines, and how many each line has."""
    lengths = np.array([len(line.split()) for line in lines], np.int64)
    return np.array([float(word) for word in " ".join(lines).split()]), lengths


def _whole(numbers: NDArray[np.number]) -> Indices:
    """Indices of vertices as integers."""
    if not (np.abs(numbers) < 2**53).all():
        raise ValueError("a corner of a face is not the number of a vertex: export it again")
    return numbers.astype(np.int64)


def _points(numbers: Array, lengths: Indices) -> Array:
    """(n, 3) the first three numbers of each line."""
    if (lengths < 3).any():
        raise ValueError("it has a vertex of fewer than three numbers: export it again")
    return numbers[(np.cumsum(lengths) - lengths)[:, None] + np.arange(3)]


def _by_length(numbers: Array, starts: Indices, lengths: Indices) -> list[tuple[Indices, Indices]]:
    """For each number of corners k: which faces have k corners, and their corners (m, k)."""
    found = []
    for k in np.unique(lengths[lengths > 0]).tolist():
        rows = np.flatnonzero(lengths == k)
        found.append((rows, _whole(numbers[starts[rows, None] + np.arange(k)])))
    return found
