"""Images for checks, made by code."""

import threading
from collections.abc import Callable, Sequence
from functools import cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.contract.check import expect
from zpm2.evaluate.rendered import render_scene
from zpm2.model import Image
from zpm2.runtime import ForkAwareLock

Given = TypeVar("Given")
Found = TypeVar("Found")

# Image px, pixel centres at +0.5: a view of a plane from a little to the side.
HOMOGRAPHY = np.array([[0.96, 0.07, 6.0], [-0.05, 1.01, 9.0], [4e-5, -3e-5, 1.0]])


@cache
def scene() -> tuple[Image, Image]:
    """A small room with objects, from two sides."""
    rendered = render_scene(0, 400, 300)
    return Image(rendered.left), Image(rendered.right)


@cache
def plane() -> tuple[Image, Image]:
    """A textured plane, and the same after `HOMOGRAPHY`."""
    left = texture(320, 256)
    return Image(left), Image(warped(left, HOMOGRAPHY))


def texture(width: int, height: int, seed: int = 0) -> NDArray[np.uint8]:
    """(height, width, 3) something like a photograph: octaves of smooth noise, and shapes with edges and corners."""
    random = np.random.default_rng(seed)
    out = np.zeros((height, width, 3), np.float32)
    for octave in range(6):
        noise = random.standard_normal(out.shape).astype(np.float32)
        noise = cv2.GaussianBlur(noise, (0, 0), 2.0**octave)
        out += noise / max(float(noise.std()), 1e-6) * 2.0 ** (octave / 2)
    for _ in range(60):
        x, y, side = (int(random.integers(0, n)) for n in (width, height, 40))
        colour = tuple(float(c) for c in random.normal(0, 4, 3))
        if random.random() < 0.5:
            cv2.circle(out, (x, y), 3 + side // 2, colour, -1, cv2.LINE_AA)
        else:
            cv2.rectangle(out, (x, y), (x + 5 + side, y + int(random.integers(5, 40))), colour, -1)
    out = cv2.GaussianBlur(out, (0, 0), 0.7)
    return np.clip((out - out.mean()) / max(float(out.std()), 1e-6) * 45 + 128, 0, 255).astype(np.uint8)


def warped(rgb: NDArray[np.uint8], homography: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The same picture after `homography`, which is in image px; OpenCV counts pixel centres from 0."""
    centre = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    matrix = np.linalg.inv(centre) @ homography @ centre
    size = (rgb.shape[1], rgb.shape[0])
    return np.asarray(cv2.warpPerspective(rgb, matrix, size, flags=cv2.INTER_CUBIC), np.uint8)


def grey(width: int, height: int, value: int) -> Image:
    """An image of one grey value."""
    return Image(np.full((height, width, 3), value, np.uint8))


def half_valid(image: Image) -> Image:
    """An image whose left half holds no data, and a block of its right half neither."""
    valid = np.ones((image.height, image.width), bool)
    valid[:, : image.width // 2] = False
    valid[: image.height // 3, -image.width // 4 :] = False
    return Image(np.where(valid[..., None], image.rgb, np.uint8(0)), valid=valid)


def no_data(image: Image) -> Image:
    """An image of that size without any data."""
    return Image(np.zeros_like(image.rgb), valid=np.zeros((image.height, image.width), bool))


def unchanged(images: Sequence[Image], work: Callable[[], object]) -> None:
    """`Broken` where `work` writes into one of the images."""
    before = [(image.rgb.tobytes(), None if image.valid is None else image.valid.tobytes()) for image in images]
    work()
    after = [(image.rgb.tobytes(), None if image.valid is None else image.valid.tobytes()) for image in images]
    expect(
        before == after, "it writes into the pixels of the image that it is given: work on a copy (image.rgb.copy())"
    )


def in_threads(work: Callable[[Given], Found], given: Sequence[Given]) -> list[Found]:
    """What `work` returns for each, in a thread of its own; threads take turns by a lock, as those of a matcher do."""
    lock, found, failed = ForkAwareLock(), dict[int, Found](), list[BaseException]()

    def one(k: int) -> None:
        try:
            with lock:
                found[k] = work(given[k])
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=one, args=(k,)) for k in range(len(given))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        raise failed[0]
    return [found[k] for k in range(len(given))]
