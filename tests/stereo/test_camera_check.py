"""Cameras that are not those of their image: refused where that is certain, said where it is likely."""

import re
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.errors import InputError
from zpm2.model import Camera
from zpm2.stereo.camera_check import checked, doubts, fitting_size, orientation

SIZE = (640, 480)


def camera(f: float, cx: float, cy: float, size: tuple[int, int] = SIZE, bent: tuple[float, ...] = ()) -> Camera:
    return Camera(np.array([[f, 0, cx], [0, f, cy], [0, 0, 1.0]]), size, np.array(bent))


@given(
    st.integers(200, 6000),
    st.floats(1.1, 2.5),
    st.floats(-0.02, 0.02),
    st.floats(-0.02, 0.02),
    st.floats(0.3, 6.0),
    st.booleans(),
)
def test_a_camera_near_the_middle_fits_its_image_and_never_the_turned_one(
    short: int, aspect: float, dx: float, dy: float, focal: float, tall: bool
) -> None:
    size = (short, round(short * aspect)) if tall else (round(short * aspect), short)
    there = (0.5 + dx) * size[0], (0.5 + dy) * size[1]
    f = focal * max(size)
    assert doubts(checked(camera(f, *there, size))) == []
    if max(abs(dx), abs(dy)) < 0.01:
        with pytest.raises(InputError, match=r"fits|outside"):
            checked(camera(f, *there, size[::-1]))


def test_the_camera_of_the_image_as_it_is_shown(tmp_path: Path) -> None:
    picture = PIL.Image.new("RGB", SIZE)
    exif = picture.getexif()
    exif[0x0112] = 6
    picture.save(tmp_path / "turned.jpg", exif=exif)
    turned = str(tmp_path / "turned.jpg")
    assert orientation(turned) == 6
    assert orientation(str(tmp_path / "none.jpg")) == 1
    with pytest.raises(InputError, match=r"fits 480 x 640 px: .* 640 x 480 px, .*\(EXIF orientation 6\); give the cam"):
        checked(camera(600, 240, 320), "K", turned)
    with pytest.raises(InputError, match=r"\(240, 320\), which fits 480 x 640 px: the image has 640 x 480 px; give"):
        checked(camera(600, 240, 320))
    with pytest.raises(InputError, match=r"is for an image of 480 x 640 px, .*EXIF orientation 6"):
        fitting_size(camera(600, 240, 320, (480, 640)), SIZE, "K", turned)
    checked(camera(600, 320, 240), "K", turned)


@pytest.mark.parametrize(
    ("odd", "why"),
    [
        (camera(300, 160, 120), "25 % of a side from the middle .* made for another size"),
        (camera(85, 320, 240), "focal length of 85 px, unusual"),
        (camera(60000, 320, 240), "unusual"),
        (Camera(np.array([[600.0, 0, 320], [0, 250, 240], [0, 0, 1]]), SIZE), "from square"),
        (camera(500, 320, 240, bent=(-0.6,)), "cannot be undone"),
        (camera(500, 320, 240, bent=(-3.0, 0, 0, 0)), "cannot be undone"),
    ],
)
def test_what_is_odd_is_said(odd: Camera, why: str) -> None:
    (said,) = doubts(checked(odd), "the left camera")
    assert said.startswith("the left camera has ")
    assert re.search(why, said)


def test_a_skew_is_refused_where_it_would_show() -> None:
    skewed = camera(500, 320, 240)
    skewed.matrix[0, 1] = 0.02  # moves the corners by just under 0.01 px, as rounding may
    checked(skewed)
    skewed.matrix[0, 1] = -40
    with pytest.raises(InputError, match=r"K has a skew of -40, which moves points by up to 19 px: resample"):
        checked(skewed)


def test_usual_distortions_are_not_odd() -> None:
    for bent in ((-0.3,), (-0.3, 0.1), (-0.28, 0.07, 0.001, -0.001), (0.05, -0.1, 0, 0, 0.02)):
        assert doubts(checked(camera(600, 320, 240, bent=bent))) == []


@pytest.mark.parametrize("focal", [35.0, 63.0, 130000.0])
def test_focal_lengths_in_other_units(focal: float) -> None:
    with pytest.raises(InputError, match="must be in px"):
        checked(camera(focal, 320, 240))
