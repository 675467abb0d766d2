"""COLMAP models: our reader of text against pycolmap, awkward files, and whose camera is whose."""

from pathlib import Path

import numpy as np
import pytest

from zpm2.errors import InputError
from zpm2.formats.colmap import camera_of, read_cameras, read_poses

CAMERAS = "# list\n1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n\n2 PINHOLE 800 600 700 710 400 300\n"
FISHEYE = "3 OPENCV_FISHEYE 640 480 500 500 320 240 0 0 0 0\n"
FIRST = "1 0.8 0.6 0 0 1 2 3 1 {}\n"
SECOND = "2 0.6 0 -0.8 0 -1 0.5 2 2 {}\n"
POINTS = "10.5 20 -1 30 40 7\n"

LAYOUTS = {
    "points": (f"# list\n{FIRST}{POINTS}{SECOND}{POINTS}", ("a.png", "b.png")),
    "empty lines of points": (f"{FIRST}\n{SECOND}\n", ("a.png", "b.png")),
    "empty lines between": (f"\n# list\n\n{FIRST}{POINTS}\n\n{SECOND}\n\n\n", ("a.png", "b.png")),
    "comments between": (f"{FIRST}\n# half\n  # indented\n{SECOND}{POINTS}# end\n", ("a.png", "b.png")),
    "sub-folders": (f"{FIRST}{POINTS}{SECOND}{POINTS}", ("left/0.png", "right/0.png")),
}


def model(folder: Path, images: str, names: tuple[str, ...], cameras: str = CAMERAS, newline: str = "\n") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    words = iter(names)
    text = "".join(line.format(next(words)) if "{}" in line else line for line in images.splitlines(True))
    for name, content in (("cameras.txt", cameras), ("images.txt", text), ("points3D.txt", "# none\n")):
        (folder / name).write_bytes(content.replace("\n", newline).encode())
    return folder


def same(folder: Path, other: Path) -> None:
    here, there = read_poses(folder), read_poses(other)
    assert list(here) == list(there)
    for name in here:
        assert here[name].rotation == pytest.approx(there[name].rotation, abs=1e-12)
        assert here[name].translation == pytest.approx(there[name].translation, abs=1e-12)
        assert np.array_equal(here[name].camera.matrix, there[name].camera.matrix)
        assert np.array_equal(here[name].camera.distortion, there[name].camera.distortion)
        assert here[name].camera.size == there[name].camera.size


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_text_is_read_as_pycolmap_reads_it(layout: str, newline: str, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    text = model(tmp_path / "text", *LAYOUTS[layout], newline=newline)
    (tmp_path / "binary").mkdir()
    pycolmap.Reconstruction(str(text)).write_binary(str(tmp_path / "binary"))
    assert list(read_poses(text)) == list(LAYOUTS[layout][1])
    same(text, tmp_path / "binary")


@pytest.mark.parametrize(
    "images",
    [
        f"{FIRST}# a comment\n{POINTS}{SECOND}{POINTS}",  # pycolmap: an error
        f"{FIRST}{POINTS}{SECOND}".rstrip("\n"),  # pycolmap leaves the last image out
        f"{FIRST}{SECOND}",  # and every second one here
    ],
)
@pytest.mark.parametrize("name", ["b.png", "a b/0 1.png"])
def test_text_that_pycolmap_misreads(images: str, name: str, tmp_path: Path) -> None:
    """Names with spaces too, of which it takes the first word; COLMAP's own binary files hold them whole."""
    text = model(tmp_path / "text", images, ("z.png", name))
    (text / "points3D.txt").unlink()
    whole = model(tmp_path / "whole", LAYOUTS["points"][0], ("z.png", "b.png"))
    here, there = read_poses(text), read_poses(whole)
    assert list(here) == sorted(["z.png", name])
    for mine, other in ((name, "b.png"), ("z.png", "z.png")):
        assert here[mine].rotation == pytest.approx(there[other].rotation)
        assert here[mine].camera.size == there[other].camera.size


def test_names_with_spaces_in_binary_files(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    text = model(tmp_path / "text", LAYOUTS["points"][0], ("z.png", "a b/0 1.png"))
    made = pycolmap.Reconstruction(str(text))
    made.images[2].name = "a b/0 1.png"
    (tmp_path / "binary").mkdir()
    made.write_binary(str(tmp_path / "binary"))
    same(text, tmp_path / "binary")


def test_photographs_of_one_name_have_their_own_cameras(tmp_path: Path) -> None:
    cameras = read_cameras(model(tmp_path, LAYOUTS["points"][0], ("left/0.png", "right/0.png")))
    assert camera_of(cameras, tmp_path / "left" / "0.png", "K").size == (640, 480)
    assert camera_of(cameras, tmp_path / "far" / "right" / "0.png", "K").size == (800, 600)
    assert camera_of(cameras, "far/../right/0.png", "K").size == (800, 600)
    with pytest.raises(InputError, match=r"images left/0\.png, right/0\.png, and .* is none of them"):
        camera_of(cameras, tmp_path / "0.png", "K")
    with pytest.raises(InputError, match=r"no image '1\.png' and more than one camera"):
        camera_of(cameras, tmp_path / "left" / "1.png", "K")


def test_the_longest_name_counts_and_one_camera_is_no_choice(tmp_path: Path) -> None:
    cameras = read_cameras(model(tmp_path / "a", LAYOUTS["points"][0], ("0.png", "right/0.png")))
    assert camera_of(cameras, "right/0.png", "K").size == (800, 600)
    assert camera_of(cameras, "left/0.png", "K").size == (640, 480)
    one = f"{FIRST}\n{SECOND}\n".replace(" 2 2 {}", " 2 1 {}")
    cameras = read_cameras(model(tmp_path / "b", one, ("left/0.png", "right/0.png")))
    assert camera_of(cameras, "elsewhere/0.png", "K").size == (640, 480)


@pytest.mark.parametrize("binary", [False, True])
def test_a_foreign_camera_bars_no_other(binary: bool, tmp_path: Path) -> None:
    images = f"{FIRST}\n{SECOND}\n" + SECOND.replace("2 0.6", "3 0.6").replace(" 2 2 {}", " 2 3 {}") + "\n"
    folder = model(tmp_path / "text", images, ("a.png", "b.png", "c.png"), CAMERAS + FISHEYE)
    if binary:
        pycolmap = pytest.importorskip("pycolmap")
        read = pycolmap.Reconstruction(str(folder))
        folder = tmp_path / "binary"
        folder.mkdir()
        read.write_binary(str(folder))
    cameras = read_cameras(folder)
    assert camera_of(cameras, "b.png", "K").size == (800, 600)
    with pytest.raises(InputError, match="OPENCV_FISHEYE"):
        camera_of(cameras, "c.png", "K")
    notes: list[str] = []
    assert list(read_poses(folder, notes)) == ["a.png", "b.png"]
    assert "1 of 3 photographs have a camera of model OPENCV_FISHEYE" in notes[0]
    with pytest.raises(InputError, match="OPENCV_FISHEYE"):
        read_poses(folder)


@pytest.mark.parametrize(
    ("images", "cameras", "why"),
    [
        (FIRST.format("a.png").replace(" 1 a", " 9 a"), CAMERAS, "images of camera 9 but lacks this camera"),
        (FIRST.format("a.png").replace("0.8", "x"), CAMERAS, "not a complete COLMAP model"),
        ("1 0 0 0 0 1 2 3 1 a.png\n", CAMERAS, "not a complete COLMAP model"),
        ("1 1 0 0\n", CAMERAS, "not a complete COLMAP model"),
        (FIRST.format("a.png"), "1 PINHOLE 640\n", "not a complete COLMAP model"),
        (FIRST.format("a.png"), "1 PINHOLE 640 480 500 500\n", "wrong parameters"),
        ("# none\n", CAMERAS, "no registered image"),
    ],
)
def test_models_that_are_damaged(images: str, cameras: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=why) as error:
        read_poses(model(tmp_path, images, (), cameras))
    assert "\n" not in str(error.value)
