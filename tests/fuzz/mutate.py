"""Damaged versions of a valid file: bytes, words, JSON values, and what is packed in a file or a PNG's chunks."""

import gzip
import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

SIZE = 48, 40  # px, of the photographs among the samples
Change = Callable[[bytes, random.Random], bytes]

WORDS = (
    *("0", "-1", "1", "nan", "inf", "-inf", "1e999", "1e308", "-1e-320", "0.5", "2147483648", "4294967295"),
    *("9223372036854775808", "18446744073709551616", "1" * 400, "9" * 5000, "", "x", "%s", "..", "\0", "a" * 5000),
    *("\ud7ff", "é", "true", "null", "[]", "{}", '"', "[" * 3000, '{"a":' * 3000, "/dev/zero", "/", "∞", "٣"),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 0.5, 1e308, -0.0, 2**31, 2**53, 2**63, 2**64, 10**290, float("nan"), float("inf")),
    *("", "x", "a" * 5000, "\0", "\ud800", "1", "/", "..", [], {}, [[]], [None], [0], [[0, 0]], {"a": 1}, {"id": []}),
)
NUMBERS = (
    0,
    1,
    2,
    3,
    127,
    128,
    255,
    256,
    32767,
    32768,
    65535,
    65536,
    2**24,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63,
    2**64 - 1,
)
OTHERS = (  # what may lie under a name that says something else
    *(b"", b"\0", b"\n", b"%!PS-Adobe-3.0 EPSF-3.0\n", b"%PDF-1.7\n", b"<html></html>", b"#!/bin/sh\n", b"\x7fELF"),
    *(b"II*\0\x08\0\0\0\0\0", b"MM\0*", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM", b"GIF89a", b"RIFF\0\0\0\0WEBP"),
    *(
        b"PK\3\4",
        b"PK\5\6" + bytes(18),
        b"\x1f\x8b\x08",
        b"\x93NUMPY",
        b"Pf\n1 1\n1\n",
        b"ply\n",
        b"OFF\n",
        b"solid \n",
    ),
    *(b"{}", b"[]", b"null", b"\xef\xbb\xbf", b"\xff\xfe", b"<VRTDataset/>", b"glTF\2\0\0\0", b"SQLite format 3\0"),
)


def mutant(content: bytes, name: str, chance: random.Random) -> bytes:
    """One to three changes of a file, of a kind that fits its name among them."""
    kinds = [_BYTES, *(_BY_ENDING.get(name.rpartition(".")[2], ()),) * 2]
    for _ in range(chance.choice((1, 1, 2, 3))):
        content = chance.choice(chance.choice([kind for kind in kinds if kind]))(content, chance)
    return content


def _place(content: bytes, chance: random.Random) -> int:
    """A place in a file, half of them where its header is."""
    return chance.randrange(min(len(content), 64 if chance.random() < 0.5 else len(content)) or 1)


def _slice(content: bytes, chance: random.Random) -> slice:
    start = _place(content, chance)
    return slice(start, start + chance.choice((1, 2, 4, 8, 16, 64, 256)))


def _flipped(content: bytes, chance: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8))):
        if changed:
            changed[_place(content, chance)] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: _place(content, chance)]


def _doubled(content: bytes, chance: random.Random) -> bytes:
    part = _slice(content, chance)
    return content[: part.stop] + content[part] * chance.choice((1, 1, 50)) + content[part.stop :]


def _without(content: bytes, chance: random.Random) -> bytes:
    part = _slice(content, chance)
    return content[: part.start] + content[part.stop :]


def _with_noise(content: bytes, chance: random.Random) -> bytes:
    start = _place(content, chance)
    return content[:start] + chance.randbytes(chance.choice((1, 4, 32))) + content[start:]


def _with_number(content: bytes, chance: random.Random) -> bytes:
    """Two, four or eight bytes become a number that is near some limit, as a length in a header may."""
    kind, start = chance.choice("BHIQ"), _place(content, chance)
    value = chance.choice(NUMBERS) % 256 ** struct.calcsize(kind)
    packed = struct.pack(chance.choice("<>") + kind, value)
    return content[:start] + packed + content[start + len(packed) :]


def _with_sizes(content: bytes, chance: random.Random) -> bytes:
    """Every number that may be a side of the picture becomes one of many thousands."""
    kind = chance.choice(("<H", ">H", "<I", ">I"))
    for side in SIZE if chance.random() < 0.7 else chance.choices(SIZE):
        content = content.replace(struct.pack(kind, side), struct.pack(kind, chance.choice((300, 9000, 31000, 65535))))
    return content


def _swapped(content: bytes, chance: random.Random) -> bytes:
    size = chance.choice((1, 2, 4, 8))
    a, b = sorted((_place(content, chance), _place(content, chance)))
    b = max(b, a + size)
    return content[:a] + content[b : b + size] + content[a + size : b] + content[a : a + size] + content[b + size :]


def _words(content: bytes, chance: random.Random) -> bytes:
    """A word or a number in a text becomes another one."""
    found = list(re.finditer(rb"[-+.\w]+", content))
    if not found:
        return content
    one = chance.choice(found)
    new = chance.choice(WORDS).encode() if chance.random() < 0.7 else chance.choice(found)[0]
    return content[: one.start()] + new + content[one.end() :]


def _lines(content: bytes, chance: random.Random) -> bytes:
    lines = content.split(b"\n")
    k = chance.randrange(len(lines))
    how = chance.randrange(4)
    if how == 0:
        del lines[k]
    elif how == 1:
        lines.insert(k, chance.choice(lines))
    elif how == 2:
        lines[k] = lines[k] * 200
    else:
        lines[k] = lines[k][: _place(lines[k], chance)]
    return b"\n".join(lines)


def _long_line(content: bytes, chance: random.Random) -> bytes:
    start = _place(content, chance)
    return (
        content[:start]
        + chance.choice((b"1", b"1 ", b"a", b"\xff", b"<a>", b",", b" ", b"\n", b"\n ")) * 100_000
        + content[start:]
    )


def _other(content: bytes, chance: random.Random) -> bytes:
    """Something else under this name, or nothing."""
    other = chance.choice(OTHERS)
    return other + content if other and chance.random() < 0.3 else other


def _in_glb(content: bytes, chance: random.Random) -> bytes:
    """The JSON of a GLB changes, and the lengths with it."""
    size = int.from_bytes(content[12:16], "little")
    text, rest = _json(content[20 : 20 + size], chance), content[20 + size :]
    text += b" " * (-len(text) % 4)
    return content[:8] + struct.pack("<III", 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def _json(content: bytes, chance: random.Random) -> bytes:
    """A value somewhere in a JSON text becomes another one, goes, or changes places."""
    try:
        root = [json.loads(content)]
    except (ValueError, RecursionError):
        return _words(content, chance)
    holder: Any = root
    while True:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        key = chance.choice(keys)
        inner = holder[key]
        if not (isinstance(inner, dict | list) and inner) or chance.random() < 0.2:
            break
        holder = inner
    how = chance.random()
    if how < 0.7:
        holder[key] = chance.choice(VALUES)
    elif how < 0.85 and holder is not root:
        del holder[key]
    elif isinstance(holder, list):
        holder.append(inner)
    else:
        holder[key] = [inner] * 3
    return json.dumps(root[0] if root else None).encode()


def _in_zip(content: bytes, chance: random.Random) -> bytes:
    """A member of a zip file changes, and its checksum with it."""
    out = io.BytesIO()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
            names = old.namelist()
            chosen = chance.choice(names) if names else ""
            for name in names:
                data = old.read(name)
                if name == chosen:
                    data = bytes(10**8) if chance.random() < 0.02 else chance.choice(_BYTES)(data, chance)
                new.writestr(name, data)
    except Exception:  # it is damaged already
        return content
    return out.getvalue()


def _in_gzip(content: bytes, chance: random.Random) -> bytes:
    try:
        inner = gzip.decompress(content)
    except Exception:  # it is damaged already
        return content
    return gzip.compress(b"[" * 10**8 if chance.random() < 0.005 else _json(inner, chance), 1)


def _in_chunk(content: bytes, chance: random.Random) -> bytes:
    """A chunk of a PNG changes, and its checksum with it."""
    chunks, place = [], 8
    while place + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, place)
        chunks.append((content[place + 4 : place + 8], content[place + 8 : place + 8 + size]))
        place += 12 + size
    if not chunks:
        return content
    k = chance.randrange(len(chunks))
    chunks[k] = chunks[k][0], chance.choice((*_BYTES, _with_sizes))(chunks[k][1], chance)
    return content[:8] + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


_BYTES: tuple[Change, ...] = (
    *(_flipped, _cut, _doubled, _without, _with_noise, _with_number, _with_number, _swapped, _other, _long_line),
)
_TEXT: tuple[Change, ...] = (_words, _words, _words, _lines)
_BY_ENDING: dict[str, tuple[Change, ...]] = {
    **dict.fromkeys(("txt", "toml", "csv", "obj", "off", "camera", "jsonl", "pfm", "ply", "stl", "vrt"), _TEXT),
    **dict.fromkeys(("json", "geojson"), (_json, _json, _json, _words)),
    "glb": (_in_glb, _in_glb),
    "npz": (_in_zip,),
    "gz": (_in_gzip,),
    "npy": (_words,),
    "png": (_in_chunk, _in_chunk, _with_sizes),
    **dict.fromkeys(("jpg", "tif", "webp", "bmp", "jp2"), (_with_sizes,)),
}
