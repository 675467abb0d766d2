import numpy as np
import pytest

from zpm2.errors import OutputError
from zpm2.photos.shelf import Shelf

ARRAYS = {"a": np.array([[0.1, -0.0], [np.nan, 1e-310]]), "b": np.zeros((0, 3), np.float32), "c": np.array((7, 5))}


def test_arrays_come_back_byte_for_byte(tmp_path):
    shelf = Shelf(tmp_path, 1e6)
    shelf.put("key", ARRAYS)
    again = shelf.get("key")
    assert list(again) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert (again[name].dtype, again[name].shape) == (array.dtype, array.shape)
        assert again[name].tobytes() == array.tobytes()
        assert again[name].flags.writeable
    assert shelf.get("another") is None


def test_what_would_be_too_much_is_not_taken(tmp_path):
    shelf = Shelf(tmp_path, 250)
    for key in "abca":
        shelf.put(key, {"x": np.full(12, ord(key))})
    assert shelf.taken == 192
    assert [shelf.get(key) is None for key in "abc"] == [False, False, True]
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("content", [None, b"", b"no archive"])
def test_what_somebody_removed_or_damaged_is_gone(tmp_path, content):
    shelf = Shelf(tmp_path, 1e6)
    shelf.put("key", ARRAYS)
    (file,) = tmp_path.iterdir()
    file.unlink() if content is None else file.write_bytes(content)
    assert shelf.get("key") is None


def test_a_disk_that_takes_nothing_is_told(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write .*0\.npz"):
        Shelf(tmp_path / "none", 1e6).put("key", ARRAYS)
