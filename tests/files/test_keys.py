"""What tells whether an earlier run's results may be taken."""

import os

from zpm2.files import keys
from zpm2.files.keys import BLOCK, BLOCKS, fingerprint, key, stamp


def test_a_file_that_was_replaced_gives_another_key(tmp_path):
    file = tmp_path / "a.png"
    file.write_bytes(b"one")
    first = key([file], {"a": 1})
    assert key([str(file)], {"a": 1}) == first
    assert key([file], {"a": 2}) != first
    assert key([file, file], {"a": 1}) != first
    os.utime(file, ns=(1, 1))
    assert key([file], {"a": 1}) != first
    time = file.stat().st_mtime_ns
    before = key([file])
    file.write_bytes(b"two")
    os.utime(file, ns=(time, time))  # same size, same time
    assert key([file]) != before
    file.unlink()
    assert key([file]) not in (first, before)
    assert stamp(file) is None


def test_where_a_file_lies_does_not_matter(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "x.png").write_bytes(b"same")
        os.utime(tmp_path / name / "x.png", ns=(5, 5))
    assert key([tmp_path / "a" / "x.png"]) == key([tmp_path / "b" / "x.png"])


def test_other_code_gives_another_key(monkeypatch):
    first = key([], 1)
    assert key([], 1) == first
    monkeypatch.setattr(keys, "code", lambda: "other")
    assert key([], 1) != first


def test_large_files_are_looked_at_in_places_all_over(tmp_path):
    """First and last byte included; files of up to 64 blocks are looked at as a whole."""
    size = 3 * BLOCK * BLOCKS
    file = tmp_path / "large"
    with file.open("wb") as opened:
        opened.truncate(size)
    seen = {fingerprint(file)}
    for at in (0, size - 1, size // 2):
        with file.open("r+b") as opened:
            opened.seek(at - at % BLOCK if 0 < at < size - 1 else at)
            opened.write(b"\1" * (3 * BLOCK if 0 < at < size - 1 else 1))
        seen.add(fingerprint(file))
    assert len(seen) == 4
    small = tmp_path / "small"
    content = bytearray(BLOCK * 5 + 17)
    small.write_bytes(content)
    found = {fingerprint(small)}
    for at in range(0, len(content), 9973):
        content[at] = 1
        small.write_bytes(content)
        found.add(fingerprint(small))
    assert len(found) == 2 + (len(content) - 1) // 9973
    (tmp_path / "empty").write_bytes(b"")
    assert fingerprint(tmp_path / "empty").startswith("0-")
