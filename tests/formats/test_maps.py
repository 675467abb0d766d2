import cv2
import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from zpm2.errors import InputError
from zpm2.formats.maps import read_disparity, read_map

VALUES = np.array([[1.5, 0.0, 3.0], [7.25, np.inf, 2.0]], np.float32)
KNOWN = np.array([[1.5, np.nan, 3.0], [7.25, np.nan, 2.0]], np.float32)


def pfm(values, scale=b"-1.0", kind=b"Pf", newline=b"\n"):
    order = "<f4" if float(scale) < 0 else ">f4"
    header = kind + newline + b"%d %d" % values.shape[::-1] + newline + scale + newline
    return header + values[::-1].astype(order).tobytes()


def write(path, values):
    if path.suffix == ".npy":
        np.save(path, values)
    else:
        path.write_bytes(pfm(values))


@pytest.mark.parametrize("scale", [b"-1.0", b"1.0", b"-0.003922", b"1e0"])
@pytest.mark.parametrize("newline", [b"\n", b" \n", b"\r\n"])
def test_pfm_of_either_byte_order(tmp_path, scale, newline):
    (tmp_path / "d.pfm").write_bytes(pfm(VALUES, scale, newline=newline))
    found = read_map(tmp_path / "d.pfm", (3, 2))
    assert found.dtype == np.float32
    assert np.array_equal(found, KNOWN, equal_nan=True)


def test_pfm_sign_is_dropped_and_data_may_begin_like_white_space(tmp_path):
    (tmp_path / "d.pfm").write_bytes(pfm(-VALUES))
    assert np.array_equal(read_map(tmp_path / "d.pfm"), KNOWN, equal_nan=True)
    odd = np.frombuffer(b"\n\n \n\r\n\n ", "<f4").reshape(1, 2)
    (tmp_path / "d.pfm").write_bytes(pfm(odd))
    assert np.array_equal(read_map(tmp_path / "d.pfm", scale=1e-30), odd / np.float32(1e-30))


@pytest.mark.parametrize("suffix", ["pfm", "npy"])
def test_the_sign_is_that_of_the_file_or_the_other_one_or_always_positive(tmp_path, suffix):
    for stored in (VALUES, -VALUES):
        write(tmp_path / f"d.{suffix}", stored)
        for sign, expected in ((1, np.sign(stored[0, 0])), (-1, -np.sign(stored[0, 0])), (0, 1)):
            found = read_disparity(tmp_path / f"d.{suffix}", scale=2, sign=sign)
            assert np.array_equal(found, expected * KNOWN / 2, equal_nan=True)


@pytest.mark.parametrize("suffix", ["pfm", "npy"])
@pytest.mark.parametrize("sign", [1, -1, 0])
def test_a_mixed_sign_is_refused(tmp_path, suffix, sign):
    values = np.random.default_rng(0).uniform(1, 50, (20, 30)).astype(np.float32)
    values[:, :10] *= -1
    write(tmp_path / f"d.{suffix}", values)
    with pytest.raises(InputError, match=r"200 values below 0 and 400 above: disparities have one sign"):
        read_disparity(tmp_path / f"d.{suffix}", sign=sign)


def test_few_values_of_the_other_sign_and_markers_are_unknown(tmp_path):
    values = np.random.default_rng(0).uniform(0.5, 50, (20, 30)).astype(np.float32)
    few, half = np.zeros((2, 20, 30), bool)
    few[0, :20], half[:, :15] = True, True
    for where, other in ((few, -values), (half, -1), (half, -9999)):
        stored = np.where(where, other, values).astype(np.float32)
        np.save(tmp_path / "d.npy", stored)
        found = read_disparity(tmp_path / "d.npy")
        assert np.array_equal(found, np.where(where, np.nan, values), equal_nan=True)


def test_a_half_of_one_value_below_zero_is_a_mixed_sign(tmp_path):
    np.save(tmp_path / "d.npy", np.where(np.arange(30) < 15, 10.0, -10.0) * np.ones((20, 1)))
    with pytest.raises(InputError, match="300 values below 0 and 300 above"):
        read_disparity(tmp_path / "d.npy")


@pytest.mark.parametrize(("dtype", "scale"), [(np.uint16, 256.0), (np.uint8, 4.0)])
def test_png_with_scale(tmp_path, dtype, scale):
    stored = np.array([[0, 1, 255], [9, 200, np.iinfo(dtype).max]], dtype)
    cv2.imwrite(str(tmp_path / "d.png"), stored)
    found = read_map(tmp_path / "d.png", scale=scale)
    assert np.isnan(found[0, 0])
    assert np.array_equal(found.ravel()[1:], stored.ravel()[1:].astype(np.float32) / np.float32(scale))


@pytest.mark.parametrize("dtype", [np.float64, np.float16, np.int32, np.uint16])
def test_npy(tmp_path, dtype):
    np.save(tmp_path / "d.npy", np.array([[0, 4], [2, 6]], dtype))
    assert np.array_equal(read_map(tmp_path / "d.npy", scale=2), [[np.nan, 2], [1, 3]], equal_nan=True)


def test_npy_below_zero_is_unknown(tmp_path):
    np.save(tmp_path / "d.npy", np.array([[-3.0, 4], [np.nan, -np.inf]]))
    assert np.array_equal(read_map(tmp_path / "d.npy"), [[np.nan, 4], [np.nan, np.nan]], equal_nan=True)


def refused(path, what, size=None):
    with pytest.raises(InputError, match=what) as error:
        read_map(path, size)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_what_cannot_be_read_is_named(tmp_path):
    refused(tmp_path / "none.pfm", "does not exist")
    refused(tmp_path / "d.tif", r"\.pfm, \.png or \.npy")
    for name in ("d.pfm", "d.png", "d.npy"):
        for content in (b"", b"Pf\n", b"nonsense", bytes(100)):
            (tmp_path / name).write_bytes(content)
            refused(tmp_path / name, "damaged")
    (tmp_path / "folder.png").mkdir()
    refused(tmp_path / "folder.png", "damaged")


def test_files_that_are_cut_short(tmp_path):
    values = np.random.default_rng(0).uniform(1, 200, (40, 50))
    (tmp_path / "d.pfm").write_bytes(pfm(values))
    cv2.imwrite(str(tmp_path / "d.png"), values.astype(np.uint16))
    np.save(tmp_path / "d.npy", values)
    for path in list(tmp_path.iterdir()):
        content = path.read_bytes()
        assert read_map(path, (50, 40)).shape == (40, 50)
        for share in (0.3, 0.6, 0.95):
            path.write_bytes(content[: int(share * len(content))])
            refused(path, "damaged")
    (tmp_path / "d.pfm").write_bytes(pfm(values) + b"more")
    refused(tmp_path / "d.pfm", "damaged")


def test_wrong_size_kind_or_nothing_known(tmp_path):
    np.save(tmp_path / "d.npy", VALUES)
    refused(tmp_path / "d.npy", "3 x 2 px, its image 6 x 4 px", (6, 4))
    refused(tmp_path / "d.npy", "3 x 2 px, its image 2 x 3 px", (2, 3))
    np.save(tmp_path / "d.npy", np.zeros((4, 5)))
    refused(tmp_path / "d.npy", "no known value")
    for wrong in (np.zeros((4, 5, 2)), np.zeros((4, 5), complex), np.zeros((4, 5), bool), np.zeros((0, 5))):
        np.save(tmp_path / "d.npy", wrong)
        refused(tmp_path / "d.npy", "shape")
    np.save(tmp_path / "d.npy", np.array([{"a": 1}], object), allow_pickle=True)
    refused(tmp_path / "d.npy", "damaged")
    (tmp_path / "d.pfm").write_bytes(pfm(np.ones((2, 9)), kind=b"PF"))
    refused(tmp_path / "d.pfm", "3 bands")
    for mode in ("RGB", "P", "LA", "1"):
        PIL.Image.new(mode, (5, 4), 1 if mode in "P1" else None).save(tmp_path / "d.png")
        refused(tmp_path / "d.png", f"mode {mode}")


@settings(max_examples=30, deadline=None)
@given(hnp.arrays(np.float32, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.floats(0.125, 1e6, width=32)))
def test_what_was_written_comes_back(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("maps")
    (folder / "d.pfm").write_bytes(pfm(values))
    np.save(folder / "d.npy", values)
    for name in ("d.pfm", "d.npy"):
        assert np.array_equal(read_map(folder / name, values.shape[::-1]), values)
