"""Cameras from numbers, files, EXIF and COLMAP; and one line for what is no camera."""

import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from zpm2.errors import Failed, InputError
from zpm2.model import Camera
from zpm2.stereo.intrinsics import from_exif, guess, read_camera, refuse_swapped

SIZE = (640, 480)
K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])


def photograph(path: Path, **exif: float) -> Path:
    picture = PIL.Image.new("RGB", SIZE)
    data = picture.getexif()
    tags = {"focal": 0x920A, "focal35": 0xA405, "plane": 0xA20E, "unit": 0xA210, "width": 0xA002}
    data.get_ifd(0x8769).update({tags[name]: value for name, value in exif.items()})
    picture.save(path, exif=data)
    return path


def test_numbers(tmp_path: Path) -> None:
    camera = read_camera("500,510,320,240", "left.png", SIZE)
    assert np.array_equal(camera.matrix, K)
    assert camera.size == SIZE
    assert camera.distortion.size == 0
    bent = read_camera("500, 510, 320, 240, -0.1, 0.01, 0, 0.001", "left.png", SIZE)
    assert bent.distortion.tolist() == [-0.1, 0.01, 0, 0.001]


def test_pixel_centres_from_zero() -> None:
    camera = read_camera("500,510,319.5,239.5", "left.png", SIZE, centers=0.0)
    assert np.array_equal(camera.matrix, K)


def test_files(tmp_path: Path) -> None:
    np.save(tmp_path / "k.npy", K)
    np.savetxt(tmp_path / "k.txt", K)
    np.savetxt(tmp_path / "k4.txt", np.block([[K, np.zeros((3, 1))], [np.zeros((1, 3)), np.eye(1)]]))
    (tmp_path / "k.json").write_text(json.dumps({"matrix": K.tolist(), "distortion": [0.1, 0]}))
    (tmp_path / "flat.txt").write_text(" ".join(str(v) for v in K.ravel()))
    for name in ("k.npy", "k.txt", "k4.txt", "k.json", "flat.txt"):
        camera = read_camera(str(tmp_path / name), "left.png", SIZE)
        assert np.array_equal(camera.matrix, K), name
        assert camera.source == "given"
    assert read_camera(str(tmp_path / "k.json"), "left.png", SIZE).distortion.tolist() == [0.1, 0]


@pytest.mark.parametrize(
    ("matrix", "why"),
    [
        (np.zeros((3, 3)), "focal lengths 0 and 0"),
        (np.full((3, 3), np.nan), "not finite"),
        (np.eye(2), "shape 2 x 2"),
        (np.ones((3, 4)), "shape 3 x 4"),
        (K @ np.diag([-1, 1, 1]), "must be positive"),
        (K + np.array([[0, 0, 400], [0, 0, 0], [0, 0, 0]]), "principal point at .* outside of the image of 640 x 480"),
        (K * 2, r"0 0 1\]"),
        (np.array([[4.2, 0, 320], [0, 4.2, 240], [0, 0, 1]]), "must be in px"),
    ],
)
def test_bad_matrices(matrix: np.ndarray, why: str, tmp_path: Path) -> None:
    np.save(tmp_path / "k.npy", matrix)
    with pytest.raises(InputError, match=why):
        read_camera(str(tmp_path / "k.npy"), "left.png", SIZE)


@pytest.mark.parametrize("text", ["500", "500,510,320", "five,510,320,240", "nowhere.txt"])
def test_bad_texts(text: str) -> None:
    with pytest.raises(InputError, match="give numbers in px"):
        read_camera(text, "left.png", SIZE)


def test_bad_files(tmp_path: Path) -> None:
    for name, content, why in (
        ("words.txt", "not a matrix", "no camera matrix"),
        ("short.txt", "1 2 3 4", "4 numbers"),
        ("bad.json", "{}", "no camera matrix"),
        ("broken.npy", "x", "no camera matrix"),
    ):
        (tmp_path / name).write_text(content)
        with pytest.raises(InputError, match=why):
            read_camera(str(tmp_path / name), "left.png", SIZE)


def test_wrong_number_of_coefficients() -> None:
    with pytest.raises(InputError, match="3 coefficients"):
        read_camera("500,510,320,240,1,2,3", "left.png", SIZE)


@pytest.mark.parametrize("count", [1, 2, 4, 5, 8])
def test_coefficients_of_distortion(count: int) -> None:
    """Those that mean something bend and unbend; a few are the first ones of more."""
    values = (-0.1, 0.01, 0.001, -0.001, 0.002, 0.0, 0.0, 0.0)[:count]
    camera = read_camera(",".join(map(str, (500, 500, 320, 240, *values))), "left.png", SIZE)
    assert camera.distortion.tolist() == list(values)
    points = np.random.default_rng(0).uniform([0, 0], SIZE, (50, 2))
    assert np.abs(camera.pixels(camera.rays(points)) - points).max() < 1e-6
    whole = Camera(camera.matrix, SIZE, np.r_[values, np.zeros(8 - count)])
    assert camera.rays(points) == pytest.approx(whole.rays(points), abs=1e-9)


@pytest.mark.parametrize("count", [3, 6, 7, 9, 12])
def test_other_numbers_of_coefficients(count: int) -> None:
    with pytest.raises(InputError, match=rf"{count} coefficients of distortion: give k1; k1,k2;") as error:
        read_camera("500,500,320,240" + ",0.01" * count, "left.png", SIZE)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["600,320,600,240", "320,240,600,600", "320,240,400,400"])
def test_numbers_in_another_order(text: str) -> None:
    with pytest.raises(InputError, match=r"has the order .*: give fx,fy,cx,cy, that is (600,600|400,400),320,240"):
        read_camera(text, "left.png", SIZE)


def test_the_camera_of_the_image_as_it_is_shown(tmp_path: Path) -> None:
    """One rule for every source of K: it is of the pixels that the file stores."""
    picture = PIL.Image.new("RGB", SIZE)
    data = picture.getexif()
    data[0x0112] = 8
    data.get_ifd(0x8769).update({0xA405: 28, 0x920A: 8.0, 0xA20E: 2000.0, 0xA210: 3, 0xA002: 480, 0xA003: 640})
    picture.save(tmp_path / "left.jpg", exif=data)
    k = np.array([[600.0, 0, 240], [0, 600, 320], [0, 0, 1]])
    np.save(tmp_path / "k.npy", k)
    np.savetxt(tmp_path / "k.txt", k)
    (tmp_path / "k.json").write_text(json.dumps({"matrix": k.tolist()}))
    (tmp_path / "sized.json").write_text(json.dumps({"matrix": k.tolist(), "width": 480, "height": 640}))
    for name, size in (("shown", "480 640"), ("stored", "640 480")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "cameras.txt").write_text(f"1 PINHOLE {size} 600 600 240 320\n")
    for text in ("600,600,240,320", *(str(tmp_path / n) for n in ("k.npy", "k.txt", "k.json", "sized.json", "shown"))):
        with pytest.raises(InputError, match=r"480 x 640 px.* 640 x 480 px.*EXIF orientation 8"):
            read_camera(text, tmp_path / "left.jpg", SIZE)
    with pytest.raises(InputError, match=r"fits 480 x 640 px"):
        read_camera(str(tmp_path / "stored"), tmp_path / "left.jpg", SIZE)
    for text in ("exif", "guess", "600,600,320,240"):
        camera = read_camera(text, tmp_path / "left.jpg", SIZE)
        assert camera.matrix[:2, 2].tolist() == [320, 240]
    data.get_ifd(0x8769).pop(0xA405)
    picture.save(tmp_path / "sensor.jpg", exif=data)  # its sides were exchanged by the program that turned it
    assert read_camera("exif", tmp_path / "sensor.jpg", SIZE).focal == pytest.approx(8.0 * 200)


def test_matrices_of_other_shapes(tmp_path: Path) -> None:
    """With nothing beside K, in a row, with comments; and the projection of a camera that is not turned (KITTI)."""
    wide, whole = np.c_[K, [-300.0, 2, 0.01]], np.block([[K, np.zeros((3, 1))], [np.zeros((1, 3)), np.eye(1)]])
    np.save(tmp_path / "wide.npy", wide)
    np.save(tmp_path / "whole.npy", whole)
    (tmp_path / "row.txt").write_text(" ".join(str(v) for v in wide.ravel()))
    (tmp_path / "rows.txt").write_text(" ".join(str(v) for v in whole.ravel()))
    (tmp_path / "said.txt").write_text("\ufeff# K\r\n" + "\r\n".join(", ".join(map(str, row)) for row in K.tolist()))
    (tmp_path / "column.txt").write_text("\n".join(str(v) for v in K.ravel()))
    for name in ("wide.npy", "whole.npy", "row.txt", "rows.txt", "said.txt", "column.txt"):
        assert np.array_equal(read_camera(str(tmp_path / name), "left.png", SIZE).matrix, K), name
    turned = K @ np.c_[[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], [1, 2, 3]]
    np.savetxt(tmp_path / "turned.txt", turned)
    with pytest.raises(InputError, match="shape 3 x 4"):
        read_camera(str(tmp_path / "turned.txt"), "left.png", SIZE)
    np.savetxt(tmp_path / "transposed.txt", K.T)
    with pytest.raises(InputError, match=r"must be \[fx s cx"):
        read_camera(str(tmp_path / "transposed.txt"), "left.png", SIZE)


def test_swapped_cameras() -> None:
    wide, tall = Camera(np.array([[500.0, 0, 500], [0, 500, 200], [0, 0, 1]]), (1000, 400)), Camera(K, SIZE)
    refuse_swapped((wide, tall))
    swapped = Camera(wide.matrix, (640, 480)), Camera(tall.matrix, (1000, 400))
    with pytest.raises(InputError, match="swapped"):
        refuse_swapped(swapped)


def test_exif(tmp_path: Path) -> None:
    equivalent = from_exif(photograph(tmp_path / "a.jpg", focal35=28), SIZE)
    assert not isinstance(equivalent, Failed)
    assert equivalent.focal == pytest.approx(28 / 43.2666 * 800, rel=1e-4)
    assert equivalent.source == "exif"
    sensor = from_exif(photograph(tmp_path / "b.jpg", focal=8.0, plane=2000.0, unit=3, width=1280), SIZE)
    assert not isinstance(sensor, Failed)
    assert sensor.focal == pytest.approx(8.0 * 200 * 640 / 1280)
    assert read_camera("exif", tmp_path / "a.jpg", SIZE).focal == equivalent.focal


def test_exif_that_says_too_little(tmp_path: Path) -> None:
    bare = photograph(tmp_path / "bare.png")
    half = photograph(tmp_path / "half.jpg", focal=8.0)
    for path, why in ((bare, "no focal length"), (half, "8 mm without the size"), (tmp_path / "no.jpg", "cannot be")):
        found = from_exif(path, SIZE)
        assert isinstance(found, Failed)
        assert why in found.reason
    with pytest.raises(InputError, match="give --K as numbers, a file, or guess"):
        read_camera("exif", bare, SIZE)


def test_a_guess_is_called_one() -> None:
    camera = read_camera("guess", "left.png", SIZE)
    assert camera.source == "guess"
    assert camera.focal == guess(SIZE).focal == 1.2 * 640


MODEL = "# comment\n1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n2 PINHOLE 800 600 700 710 400 300\n"
IMAGES = "# comment\n1 1 0 0 0 0 0 0 1 sub/left.png\n\n2 1 0 0 0 0 0 0 2 right.png\n1 2 -1\n"


def test_colmap_text(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(MODEL)
    (tmp_path / "images.txt").write_text(IMAGES)
    left = read_camera(str(tmp_path), "elsewhere/left.png", SIZE)
    assert left.matrix[0].tolist() == [500, 0, 320]
    assert left.distortion[:2].tolist() == [0.1, 0]
    right = read_camera(str(tmp_path / "cameras.txt"), "right.png", (800, 600))
    assert right.matrix[1].tolist() == [0, 710, 300]
    with pytest.raises(InputError, match=r"640 x 480 px, left\.png has 320 x 240"):
        read_camera(str(tmp_path), "left.png", (320, 240))
    with pytest.raises(InputError, match=r"no image 'other\.png' and more than one camera"):
        read_camera(str(tmp_path), "other.png", SIZE)


def test_colmap_without_images(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(MODEL.splitlines()[1])
    assert read_camera(str(tmp_path), "left.png", SIZE).focal == 500
    (tmp_path / "cameras.txt").write_text("1 OPENCV_FISHEYE 640 480 500 500 320 240 0 0 0 0")
    with pytest.raises(InputError, match="OPENCV_FISHEYE"):
        read_camera(str(tmp_path), "left.png", SIZE)
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 640 480 500")
    with pytest.raises(InputError, match="wrong parameters"):
        read_camera(str(tmp_path), "left.png", SIZE)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no cameras\.txt"):
        read_camera(str(tmp_path / "empty"), "left.png", SIZE)


def test_distortion_there_and_back() -> None:
    camera = Camera(K, SIZE, np.array([-0.25, 0.08, 0.001, -0.002, 0.01]))
    points = np.random.default_rng(0).uniform([0, 0], SIZE, (50, 2))
    assert np.abs(camera.pixels(camera.rays(points)) - points).max() < 1e-6
    assert np.abs(Camera(K, SIZE).pixels(Camera(K, SIZE).rays(points)) - points).max() < 1e-9
    assert camera.rays(np.zeros((0, 2))).shape == camera.pixels(np.zeros((0, 2))).shape == (0, 2)
