import io
import warnings

import cv2
import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from zpm2 import memory
from zpm2.errors import InputError
from zpm2.formats import read_image
from zpm2.model import Image
from zpm2.photos import images
from zpm2.photos.source import open_source

RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 256, (40, 50, 3), np.uint8)
GRAY = RGB[..., 0]


def _bytes(picture: PIL.Image.Image, kind: str, **options) -> bytes:
    out = io.BytesIO()
    picture.save(out, kind, **options)
    return out.getvalue()


@pytest.mark.parametrize("array", [RGB, GRAY, GRAY[..., None], np.dstack([RGB, np.full((40, 50), 255, np.uint8)])])
def test_8_bit_arrays_keep_their_values(array):
    image = read_image(array)
    expected = RGB if array.ndim == 3 and array.shape[2] > 1 else np.repeat(GRAY[..., None], 3, axis=2)
    assert np.array_equal(image.rgb, expected)
    assert (image.width, image.height, image.path) == (50, 40, None)


def test_the_pixels_are_a_copy():
    array = RGB.copy()
    image = read_image(array)
    array[:] = 0
    assert np.array_equal(image.rgb, RGB)


@pytest.mark.parametrize("make", [lambda a: a / 255, lambda a: a.astype(np.float32), lambda a: a.astype(np.int64)])
def test_floats_and_wide_integers_with_an_8_bit_meaning(make):
    image = read_image(make(RGB))
    assert np.array_equal(image.rgb, RGB)
    assert "brightness" in image.notes[0]


def test_booleans_become_black_and_white():
    image = read_image(GRAY > 100)
    assert set(np.unique(image.rgb)) == {0, 255}
    assert len(image.notes) == 1


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.float32])
def test_deep_values_are_stretched_and_the_note_gives_the_range(dtype):
    deep = np.linspace(300, 1300, 2000).reshape(40, 50).astype(dtype)
    image = read_image(deep)
    low, high = np.percentile(deep, (0.5, 99.5))
    assert f"from the range {low:g} to {high:g}" in image.notes[0]
    assert image.rgb.min() == 0
    assert image.rgb.max() == 255
    assert np.all(np.diff(image.rgb[..., 0].ravel().astype(int)) >= 0)


def test_dark_reflectance_is_stretched_too():
    image = read_image(np.linspace(0, 0.08, 2000, dtype=np.float32).reshape(40, 50))
    assert image.rgb.max() == 255
    assert "stretched" in image.notes[0]


def test_an_almost_constant_deep_image_is_stretched_by_its_extremes():
    deep = np.full((40, 50), 1000, np.uint16)
    deep[0, 0] = 1001
    assert read_image(deep).rgb[0, 0, 0] == 255
    assert not read_image(np.full((40, 50), 1000, np.uint16)).rgb.any()


@given(hnp.arrays(st.sampled_from([np.uint16, np.int32, np.float32]), (32, 32), elements=st.integers(0, 60000)))
def test_stretching_keeps_the_order_of_values(array):
    out = read_image(array).rgb[..., 0].ravel().astype(int)
    assert np.all(np.diff(out[np.argsort(array.ravel(), kind="stable")]) >= 0)


def test_alpha_note_says_how_much_was_transparent():
    alpha = np.full((40, 50), 255, np.uint8)
    assert "every pixel was opaque" in read_image(np.dstack([RGB, alpha])).notes[0]
    alpha[:20] = 0
    assert "50.0%" in read_image(np.dstack([RGB, alpha])).notes[0]
    assert "50.0%" in read_image(np.dstack([RGB, alpha]) / 255).notes[0]


@pytest.mark.parametrize(
    ("kind", "mode"),
    [("PNG", mode) for mode in ("L", "RGB", "RGBA", "LA", "P", "1", "I;16")]
    + [("TIFF", mode) for mode in ("L", "RGB", "RGBA", "LA", "P", "1", "I;16", "CMYK", "I", "F", "YCbCr", "PA")]
    + [
        ("memory", mode)
        for mode in ("L", "RGB", "RGBA", "LA", "La", "P", "1", "I;16", "CMYK", "I", "F", "YCbCr", "PA", "HSV")
    ],
)
def test_every_pil_mode(kind, mode, tmp_path):
    if mode == "I;16":
        picture = PIL.Image.fromarray((GRAY.astype(np.uint16) + 200) * 7)
    else:
        picture = (
            PIL.Image.fromarray(RGB).convert({"I": "L", "F": "L", "PA": "L", "La": "LA"}.get(mode, "RGB")).convert(mode)
        )
    if kind == "memory":
        image = read_image(picture)
    else:
        path = tmp_path / "picture"
        path.write_bytes(_bytes(picture, kind))
        image = read_image(path)
    assert image.rgb.shape == (40, 50, 3)
    assert image.rgb.dtype == np.uint8
    assert (mode in ("L", "RGB")) == (not image.notes)
    reference = RGB @ [0.299, 0.587, 0.114] if mode != "I;16" else GRAY
    assert np.corrcoef(image.gray.ravel(), reference.ravel())[0, 1] > (0.6 if mode == "1" else 0.95)


def test_palette_with_transparency():
    picture = PIL.Image.fromarray(RGB).convert("P")
    picture.info["transparency"] = int(np.asarray(picture)[0, 0])
    notes = read_image(picture).notes
    assert any("palette" in n for n in notes)
    assert any("alpha" in n for n in notes)


@pytest.mark.parametrize("kind", ["png", "tiff"])
def test_16_bit_colour_files_keep_their_contrast(kind, tmp_path):
    deep = np.linspace(0, 1500, 40 * 50 * 3).reshape(40, 50, 3).astype(np.uint16)  # 11 bits in 16
    path = tmp_path / f"deep.{kind}"
    assert cv2.imwrite(str(path), deep[..., ::-1])
    image = read_image(path)
    assert np.array_equal(image.rgb, read_image(deep).rgb)
    assert "16-bit integers were stretched" in image.notes[0]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_exif_orientation_is_reported_and_not_applied(orientation, kind, tmp_path):
    exif = PIL.Image.Exif()
    exif[274] = orientation
    smooth = cv2.resize(RGB[:4, :5], (50, 40), interpolation=cv2.INTER_CUBIC)
    path = tmp_path / "picture"
    path.write_bytes(_bytes(PIL.Image.fromarray(smooth), kind, exif=exif))
    image = read_image(path)
    assert image.rgb.shape == smooth.shape
    assert np.abs(image.rgb.astype(int) - smooth).mean() < 12
    assert image.notes == (
        ()
        if orientation == 1
        else (f"The EXIF orientation ({orientation}) is not applied; results are in the stored pixel frame.",)
    )


def test_damaged_exif_does_not_cost_the_picture():
    picture = PIL.Image.open(io.BytesIO(_bytes(PIL.Image.fromarray(RGB), "PNG")))
    picture.info["exif"] = b"Exif\0\0nonsense"
    assert read_image(picture).notes == ("The EXIF data is damaged and was ignored.",)


def test_only_the_first_page_is_used(tmp_path):
    pages = [PIL.Image.fromarray(RGB), PIL.Image.fromarray(255 - RGB)]
    path = tmp_path / "pages.tif"
    pages[0].save(path, save_all=True, append_images=pages[1:])
    image = read_image(path)
    assert np.array_equal(image.rgb, RGB)
    assert image.notes == ("Only the first of 2 pictures in the file is used.",)


def test_file_problems_are_one_line_that_names_the_file(tmp_path):
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "text.png").write_text("not a picture")
    noise = PIL.Image.fromarray(RNG.integers(0, 256, (300, 400, 3), np.uint8))
    for kind in ("JPEG", "PNG", "TIFF", "WEBP"):
        data = _bytes(noise, kind)
        for share in (0.02, 0.3, 0.7, 0.97):
            (tmp_path / f"cut{share}.{kind}").write_bytes(data[: int(len(data) * share)])
    (tmp_path / "cut_lzw.tif").write_bytes(_bytes(noise, "TIFF", compression="tiff_lzw")[:60000])
    (tmp_path / "cut_progressive.jpg").write_bytes(_bytes(noise, "JPEG", progressive=True)[:30000])
    (tmp_path / "dot.png").write_bytes(_bytes(PIL.Image.new("RGB", (1, 1)), "PNG"))
    (tmp_path / "folder.png").mkdir()
    paths = [*sorted(tmp_path.iterdir()), tmp_path / "missing.png", tmp_path / "empty.png" / "below.png"]
    assert len(paths) == 24
    for path in paths:
        with pytest.raises(InputError) as caught:
            read_image(path, "left image")
        message = str(caught.value)
        assert message.startswith(f"left image {path}"), message
        assert "\n" not in message


def test_permission(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"x")

    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", refuse)
    with pytest.raises(InputError, match="may not be read"):
        read_image(path)


@pytest.mark.parametrize(
    ("array", "word"),
    [
        (np.zeros((0, 40), np.uint8), "0 px"),
        (np.zeros((1, 1), np.uint8), "1 x 1 px"),
        (np.zeros((31, 400, 3), np.uint8), "at least 32 px"),
        (np.zeros((3, 40, 50), np.uint8), "channels last"),
        (np.zeros((40, 50, 2), np.uint8), "expected"),
        (np.zeros(40, np.uint8), "expected"),
        (np.array(3), "scalar"),
        (np.full((40, 50), np.nan), "2000 NaN"),
        (np.full((40, 50, 3), np.inf, np.float32), "infinite"),
        (np.zeros((40, 50), complex), "complex128"),
        (np.zeros((40, 50), object), "object"),
        (np.zeros((40, 50), "U3"), "float values"),
        ([[1, 2], [3, 4]], "got list"),
        (None, "got NoneType"),
    ],
)
def test_arrays_that_cannot_be_used(array, word):
    with pytest.raises(InputError, match=word) as caught:
        read_image(array, "right image")
    assert str(caught.value).startswith("right image")
    assert "\n" not in str(caught.value)


def test_pil_limit_is_ours_while_reading_and_untouched_afterwards(tmp_path, monkeypatch):
    path = tmp_path / "large.png"
    path.write_bytes(_bytes(PIL.Image.fromarray(RNG.integers(0, 256, (100, 100), np.uint8)), "PNG"))
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", 1000)  # PIL alone would refuse 100 x 100
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_image(path).width == 100
    assert PIL.Image.MAX_IMAGE_PIXELS == 1000
    for limit in (9000, 2000):  # PIL warns up to twice its limit and raises beyond
        monkeypatch.setattr(images, "MAX_PIXELS", limit)
        with pytest.raises(InputError, match="gigapixel"):
            read_image(path)
    assert PIL.Image.MAX_IMAGE_PIXELS == 1000
    with pytest.raises(InputError, match="gigapixel"):
        read_image(np.zeros((100, 100), np.uint8))


def test_an_image_is_taken_as_it_is() -> None:
    image = Image(np.zeros((40, 60, 3), np.uint8), valid=np.ones((40, 60), bool))
    assert read_image(image) is image
    with pytest.raises(InputError, match="each side must have at least"):
        read_image(Image(np.zeros((8, 60, 3), np.uint8)))


@pytest.mark.parametrize(
    ("image", "word"),
    [
        (Image(GRAY), r"expected an Image with rgb \(h, w, 3\) uint8, got 40 x 50 uint8: give the array itself"),
        (Image(np.dstack([RGB, GRAY])), "got 40 x 50 x 4 uint8"),
        (Image(RGB / 255), "got 40 x 50 x 3 float64"),
        (Image(RGB, valid=np.ones((3, 3), bool)), "expected an Image with valid 40 x 50 bool, got 3 x 3 bool"),
        (Image(RGB, valid=GRAY), "got 40 x 50 uint8"),
        (Image(RGB, valid=np.zeros((40, 50), bool)), "has no pixel with data"),
    ],
)
def test_images_that_cannot_be_used(image, word) -> None:
    for read in (read_image, open_source):
        with pytest.raises(InputError, match=f"^right image.*{word}"):
            read(image, "right image")


@pytest.mark.parametrize("given", [GRAY, GRAY[..., None], RGB, np.dstack([RGB, GRAY | 1])])
@pytest.mark.parametrize(("kind", "top", "garbage"), [("u1", 1, 9), ("u2", 1, 9), ("u2", 7, 60_000), ("f4", 1, np.nan)])
def test_masked_pixels_are_no_data_as_transparent_ones(given, kind, top, garbage) -> None:
    values = given.astype(kind) * top
    mask = np.zeros(values.shape, bool)
    mask[:, :20] = True
    mask[0, 30] = np.arange(values.shape[2]) == 0 if values.ndim == 3 else True  # in one band
    expected = np.dstack([np.broadcast_to(np.atleast_3d(values)[..., :3], RGB.shape), ~np.atleast_3d(mask).any(axis=2)])
    values[mask] = garbage
    image, transparent = read_image(np.ma.masked_array(values, mask)), read_image(expected.astype(kind))
    assert np.array_equal(image.valid, transparent.valid)
    assert (
        np.abs(image.rgb.astype(int) - transparent.rgb).max() <= 1
    )  # grey has other percentiles than three bands of it
    assert read_image(np.ma.masked_array(given)).valid is None
    with pytest.raises(InputError, match="no pixel with data: check its nodata value, its mask or its alpha band"):
        read_image(np.ma.masked_array(given, True))


def test_pixels_that_do_not_fit_into_memory_are_not_converted() -> None:
    wide = np.broadcast_to(np.uint16(3), (10_000, 10_000, 3))
    for pixels in (wide, PIL.Image.new("L", (10_000, 5000))):
        with (
            memory.within("100MB"),
            pytest.raises(InputError, match=r"^image \(10000 x .* px\) needs about .* of memory"),
        ):
            read_image(pixels)
