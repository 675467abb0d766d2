"""Textures: wood, stone, brick, marble, leaves, plaster and print, drawn from a random generator.

Each function returns (h, w, 3) uint8 RGB. A texel covers about 2 mm of a surface, whatever the size of the photograph.
"""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

Texture = NDArray[np.uint8]
Plane = NDArray[np.float32]
Color = tuple[float, float, float]  # RGB, 0..255


def noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[float, float], octaves: int = 4) -> Plane:
    """(h, w) value noise with mean 0 and standard deviation 1: the sum of random grids. The cells of the first have
    `cells` texels (rows, columns); each further octave is half as coarse and half as strong."""
    total = np.zeros(shape, np.float32)
    for octave in range(octaves):
        rows, columns = (max(2, min(n, int(np.ceil(n * 2**octave / c)) + 1)) for n, c in zip(shape, cells, strict=True))
        grid = rng.standard_normal((rows, columns), np.float32)
        total += cv2.resize(grid, shape[::-1], interpolation=cv2.INTER_CUBIC) * 0.5**octave
    return np.asarray((total - total.mean()) / max(float(total.std()), 1e-6), np.float32)


def _mix(a: Color, b: Color, share: NDArray[np.floating]) -> Plane:
    first, second = np.array(a, np.float32), np.array(b, np.float32)
    return np.asarray(first + (second - first) * np.clip(share, 0, 1)[..., None], np.float32)


def _bytes(colors: NDArray[np.floating]) -> Texture:
    return np.asarray(np.clip(np.rint(colors), 0, 255), np.uint8)


def _grain(rng: np.random.Generator, colors: NDArray[np.floating] | Texture, strength: float) -> Texture:
    """`colors` with fine grain, the same in all channels."""
    return _bytes(colors + strength * noise(rng, colors.shape[:2], (4, 4), 2)[..., None])


def wood(rng: np.random.Generator, h: int, w: int, dark: Color, light: Color, planks: int = 1) -> Texture:
    """Planks along the columns, each with its own tone and its own growth rings."""
    out = np.empty((h, w, 3), np.float32)
    edges = np.linspace(0, h, planks + 1).astype(int)
    for top, bottom in pairwise(edges):
        shape = (bottom - top, w)
        across = np.linspace(0, 1, bottom - top, dtype=np.float32)[:, None] * rng.uniform(2, 5)
        rings = np.sin(2 * np.pi * (across + 0.6 * noise(rng, shape, (shape[0] / 2, 250), 3)))
        fibres = noise(rng, shape, (3, 120), 3)
        plank = _mix(dark, light, 0.5 + 0.22 * rings + 0.17 * fibres + rng.uniform(-0.2, 0.2))
        if planks > 1:
            plank[:2] *= 0.45
            joint = int(rng.integers(w // 8, w))
            plank[:, joint : joint + 2] *= 0.5
        out[top:bottom] = plank
    return _bytes(out)


def stone(rng: np.random.Generator, h: int, w: int, dark: Color, light: Color) -> Texture:
    """Mottled rock with speckles and a few cracks."""
    out = _mix(dark, light, 0.5 + 0.25 * noise(rng, (h, w), (70, 70), 6))
    out *= 1 - 0.45 * np.exp(-((noise(rng, (h, w), (90, 90), 4) / 0.03) ** 2))[..., None]
    return _grain(rng, out, 9)


def marble(rng: np.random.Generator, h: int, w: int, ground: Color, vein: Color) -> Texture:
    """Veins: a sine bent by noise."""
    along = np.linspace(0, 5, w, dtype=np.float32)[None] + np.linspace(0, 3, h, dtype=np.float32)[:, None]
    veins = np.abs(np.sin(np.pi * (along + 0.7 * noise(rng, (h, w), (80, 80), 5))))
    return _grain(rng, _mix(vein, ground, veins**0.45), 4)


def brick(rng: np.random.Generator, h: int, w: int, color: Color, mortar: Color, course: int = 34) -> Texture:
    """Courses of bricks, each brick with its own tone, in light mortar."""
    out = np.empty((h, w, 3), np.float32)
    out[:] = mortar
    length, joint = course * 5 // 2, max(3, course // 9)
    for k, y in enumerate(range(0, h, course)):
        for x in range(-(k % 2) * length // 2, w, length):
            tone = rng.uniform(0.72, 1.2)
            cells = out[y : y + course - joint, max(0, x) : max(0, x + length - joint)]
            cells[:] = np.array(color, np.float32) * tone
    return _grain(rng, out * (1 + 0.09 * noise(rng, (h, w), (40, 40), 4)[..., None]), 7)


def leaves(rng: np.random.Generator, h: int, w: int) -> Texture:
    """Leaves over leaves; those on top are lighter."""
    out = np.full((h, w, 3), (22, 44, 20), np.uint8)
    count = h * w // 130
    for k in range(count):
        light = 0.35 + 0.65 * k / count
        green = np.array([70 + rng.uniform(-25, 45), 150 + rng.uniform(-25, 25), 50 + rng.uniform(-20, 20)]) * light
        center = (int(rng.integers(0, w)), int(rng.integers(0, h)))
        size = (int(rng.integers(11, 21)), int(rng.integers(4, 8)))
        angle = float(rng.uniform(0, 360))
        cv2.ellipse(out, center, size, angle, 0, 360, tuple(map(float, green)), -1, cv2.LINE_AA)
        cv2.ellipse(out, center, (size[0], 0), angle, 0, 360, tuple(map(float, green * 0.7)), 1, cv2.LINE_AA)
    return out


def plaster(rng: np.random.Generator, h: int, w: int, color: Color) -> Texture:
    """A painted wall: roller marks, faint stains."""
    tone = 1 + 0.025 * noise(rng, (h, w), (220, 220), 3) + 0.02 * noise(rng, (h, w), (10, 10), 3)
    return _bytes(np.array(color, np.float32) * tone[..., None])


def cloth(rng: np.random.Generator, h: int, w: int, ground: Color, figure: Color, border: Color) -> Texture:
    """A woven rug: borders, diamonds of changing size, threads."""
    out = np.empty((h, w, 3), np.uint8)
    out[:] = ground
    for inset, color in ((0, border), (16, figure), (24, border), (52, ground)):
        out[inset : h - inset, inset : w - inset] = color
    step = (w - 160) // 6
    for column in range(6):
        for row in range(max(1, (h - 140) // step)):
            x, y = 80 + step * column + step // 2, 70 + step * row + step // 2
            size = step * rng.uniform(0.25, 0.48)
            for share, color in ((1.0, figure), (0.6, border), (0.3, ground)):
                diamond = np.array(
                    [[x - size * share, y], [x, y - size * share], [x + size * share, y], [x, y + size * share]]
                )
                cv2.fillPoly(out, [np.rint(diamond).astype(np.int32)], color)
    return _grain(rng, out * (1 + 0.07 * noise(rng, (h, w), (3, 30), 2)[..., None]), 8)


def stripes(rng: np.random.Generator, h: int, w: int, colors: tuple[Color, ...], count: int) -> Texture:
    """Broad stripes along the rows, as on a ball or a tin."""
    band = np.array(colors, np.float32)[np.arange(w) * count // w % len(colors)]
    out = np.broadcast_to(band, (h, w, 3)) * (1 + 0.05 * noise(rng, (h, w), (60, 60), 5)[..., None])
    return _grain(rng, out, 4)


def label(rng: np.random.Generator, h: int, w: int, ground: Color, band: Color, ink: Color, word: str) -> Texture:
    """Print on a tin or a box: a band with a word that repeats around it, and lines of small print."""
    out = np.empty((h, w, 3), np.uint8)
    out[:] = ground
    out[h // 4 : h * 2 // 3] = band
    out[h // 4 - 5 : h // 4] = ink
    out[h * 2 // 3 : h * 2 // 3 + 5] = ink
    scale = h / 150
    step = int(24 * scale * len(word)) + 60
    for x in range(8, w, step):
        cv2.putText(
            out, word, (x, int(h * 0.54)), cv2.FONT_HERSHEY_DUPLEX, scale, ink, max(1, int(2 * scale)), cv2.LINE_AA
        )
        spot = (x + step // 3, h // 8)
        cv2.circle(out, spot, h // 14, tuple(float(c) for c in rng.uniform(40, 230, 3)), -1, cv2.LINE_AA)
        for line in range(h * 3 // 4, h - 6, 8):
            cv2.line(out, (x, line), (x + int(rng.uniform(0.4, 0.8) * step), line), ink, 1, cv2.LINE_AA)
    return _grain(rng, out * (1 + 0.03 * noise(rng, (h, w), (50, 50), 5)[..., None]), 4)


def landscape(rng: np.random.Generator, h: int, w: int, sky: Color, hill: Color) -> Texture:
    """A painting: a sun, clouds, ranges of hills that darken towards the viewer."""
    height = np.linspace(0, 1, h, dtype=np.float32)[:, None]
    air = _mix(sky, (250, 235, 205), np.broadcast_to(height * 1.3, (h, w)))
    out = _bytes(air + 16 * np.clip(noise(rng, (h, w), (30, 90), 5), 0, 3)[..., None])
    cv2.circle(out, (int(w * rng.uniform(0.2, 0.8)), h // 4), h // 11, (255, 226, 140), -1, cv2.LINE_AA)
    for k in range(5):
        crest = h * (0.42 + 0.12 * k) + h * 0.06 * noise(rng, (2, w), (2, w / 3), 5)[0]
        below = np.arange(h)[:, None] > crest
        shade = np.array(hill, np.float32) * (1.35 - 0.2 * k) * (1 + 0.1 * noise(rng, (h, w), (12, 25), 4)[..., None])
        out[below] = _bytes(shade)[below]
    return _grain(rng, out, 5)


def abstract(rng: np.random.Generator, h: int, w: int, ground: Color, colors: tuple[Color, ...]) -> Texture:
    """A print of discs and bars."""
    out = np.empty((h, w, 3), np.uint8)
    out[:] = ground
    for k in range(9):
        at = (int(rng.uniform(0.12, 0.88) * w), int(rng.uniform(0.12, 0.88) * h))
        size = rng.uniform(0.06, 0.2) * min(h, w)
        if k % 2:
            cv2.circle(out, at, int(size), colors[k % len(colors)], -1, cv2.LINE_AA)
        else:
            box = cv2.boxPoints((at, (size * 3.2, size * 0.8), float(rng.uniform(0, 180))))
            cv2.fillPoly(out, [np.rint(box).astype(np.int32)], colors[k % len(colors)], cv2.LINE_AA)
    return _grain(rng, out, 5)


def globe(rng: np.random.Generator, h: int, w: int) -> Texture:
    """Continents, snow at the poles, a graticule."""
    land = noise(rng, (h, w), (h / 3, h / 3), 6)
    out = _mix((40, 96, 160), (92, 160, 200), 0.5 + 0.4 * land)
    ground = _mix((196, 178, 120), (70, 128, 62), 0.5 + 0.4 * noise(rng, (h, w), (h / 5, h / 5), 5))
    out = np.where((land > 0.25)[..., None], ground, out)
    out[:: h // 8] *= 0.75
    out[:, :: w // 18] *= 0.75
    return _grain(rng, out, 4)


def framed(picture: Texture, frame: Color, rng: np.random.Generator, width: int = 18, mount: int = 26) -> Texture:
    """The picture in a white mount and a wooden frame."""
    h, w = picture.shape[:2]
    edge = width + mount
    red, green, blue = frame
    out = wood(rng, h + 2 * edge, w + 2 * edge, (0.75 * red, 0.75 * green, 0.75 * blue), frame)
    out[width:-width, width:-width] = (238, 234, 224)
    out[edge:-edge, edge:-edge] = picture
    return out
