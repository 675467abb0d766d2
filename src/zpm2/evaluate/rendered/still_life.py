"""The scene: a corner of a room with more than a dozen objects, different for each seed."""

import numpy as np
from numpy.typing import NDArray

from zpm2.evaluate.rendered.surfaces import Frustum, Rectangle, RenderedSurface, Sphere, box
from zpm2.evaluate.rendered.textures import (
    Color,
    Texture,
    abstract,
    brick,
    cloth,
    framed,
    globe,
    label,
    landscape,
    leaves,
    marble,
    plaster,
    stone,
    stripes,
    wood,
)

WALL = 4.2  # m, distance of the back wall
OAK: tuple[Color, Color] = (118, 78, 44), (196, 150, 98)
PINE: tuple[Color, Color] = (176, 126, 70), (232, 192, 136)
WALNUT: tuple[Color, Color] = (58, 36, 24), (120, 80, 54)


def still_life(rng: np.random.Generator) -> list[RenderedSurface]:
    """All surfaces of the scene, metres, room coordinates."""
    return [*_room(rng), *_pictures(rng), *_blocks(rng), *_vessels(rng), *_balls(rng), *_leaning(rng)]


def _room(rng: np.random.Generator) -> list[RenderedSurface]:
    floor = wood(rng, 1200, 2200, *OAK, planks=17)
    wall = plaster(rng, 650, 1400, _near(rng, (186, 200, 194), 18))
    board = wood(rng, 40, 1400, (206, 202, 192), (236, 232, 224))
    rug = cloth(rng, 560, 1000, (150, 44, 40), (222, 186, 120), (38, 48, 84))
    return [
        Rectangle(_at(-3.4, 0, WALL), _at(6.8, 0, 0), _at(0, 0, -3.6), floor),
        Rectangle(_at(-3.4, 3.2, WALL), _at(6.8, 0, 0), _at(0, -3.2, 0), wall),
        Rectangle(_at(-3.4, 0.13, WALL - 0.02), _at(6.8, 0, 0), _at(0, -0.13, 0), board),
        Rectangle(_at(-1.05, 0.004, 3.05), _at(2.0, 0, 0), _at(0, 0, -1.15), rug),
    ]


def _pictures(rng: np.random.Generator) -> list[RenderedSurface]:
    ink: tuple[Color, ...] = ((206, 60, 44), (36, 84, 140), (238, 182, 52), (40, 44, 52))
    sources: list[Texture] = [
        framed(landscape(rng, 300, 440, (130, 176, 216), (58, 104, 74)), (110, 70, 42), rng),
        framed(abstract(rng, 330, 240, (240, 232, 214), ink), (52, 46, 44), rng),
        framed(landscape(rng, 250, 330, (232, 168, 120), (96, 70, 108)), (196, 156, 96), rng),
    ]
    patches: list[RenderedSurface] = []
    for k, (x, texture) in enumerate(zip((-1.85, -0.25, 0.95), sources, strict=True)):
        height, width = texture.shape[0] / 560, texture.shape[1] / 560
        y = 1.84 + rng.uniform(-0.05, 0.05) + (0.04, 0.12, -0.02)[k]
        patches.append(
            Rectangle(_at(x + rng.uniform(-0.05, 0.05), y, WALL - 0.03), _at(width, 0, 0), _at(0, -height, 0), texture)
        )
    return patches


def _blocks(rng: np.random.Generator) -> list[RenderedSurface]:
    """Boxes: a crate, a brick pier with a stone slab, a chest, a carton on it, a stone cube."""
    turn = rng.uniform(-0.12, 0.12, 6)
    crate = wood(rng, 240, 300, *PINE, planks=4)
    pier = brick(rng, 420, 240, _near(rng, (168, 78, 56), 14), (204, 196, 184))
    slab = stone(rng, 160, 260, (96, 98, 104), (168, 170, 172))
    chest = wood(rng, 240, 420, *WALNUT, planks=3)
    carton = label(rng, 150, 260, (226, 214, 190), _near(rng, (38, 110, 116), 20), (40, 34, 34), "ZPM")
    cube = stone(rng, 200, 200, (134, 108, 84), (208, 186, 156))
    return [
        *box((-1.62, 0, 3.1), (0.56, 0.44, 0.5), 0.42 + turn[0], crate, crate),
        *box((1.72, 0, 3.2), (0.46, 0.86, 0.44), -0.38 + turn[1], pier, slab),
        *box((1.72, 0.86, 3.2), (0.6, 0.07, 0.56), -0.38 + turn[1], slab, slab),
        *box((0.02, 0, 3.6), (0.86, 0.46, 0.42), 0.05 + turn[2], chest, chest),
        *box((0.2, 0.46, 3.6), (0.4, 0.26, 0.24), -0.22 + turn[3], carton, plaster(rng, 120, 200, (206, 194, 168))),
        *box((-1.0, 0, 2.36), (0.3, 0.3, 0.3), 0.62 + turn[4], cube, cube),
    ]


def _vessels(rng: np.random.Generator) -> list[RenderedSurface]:
    """Round objects: tins, a flower pot with its plant, a marble column, a lamp."""
    red, blue = _near(rng, (190, 44, 40), 22), _near(rng, (44, 84, 156), 22)
    tin = label(rng, 130, 500, red, (244, 236, 214), (40, 30, 30), "TOMATO")
    tea = label(rng, 150, 420, blue, (236, 206, 120), (28, 34, 60), "TEA")
    clay = stone(rng, 130, 460, (150, 76, 50), (206, 124, 86))
    white = marble(rng, 330, 480, (236, 232, 226), (112, 112, 122))
    shade = stripes(rng, 140, 480, ((240, 206, 128), (226, 168, 84)), 14)
    lid = plaster(rng, 90, 90, (188, 190, 194))
    return [
        *_can((0.72, 0, 2.3), 0.3, 0.12, 0.12, tin, lid),
        *_can((-0.3, 0.46, 3.58), 0.27, 0.1, 0.1, tea, lid),
        *_can((-0.46, 0, 2.75), 0.3, 0.15, 0.21, clay, stone(rng, 120, 120, (44, 32, 24), (84, 62, 46))),
        Sphere(_at(-0.46, 0.53, 2.75), 0.29, _tilted(rng), leaves(rng, 460, 920)),
        *_can((-2.35, 0, 3.72), 0.8, 0.2, 0.17, white, marble(rng, 120, 120, (236, 232, 226), (112, 112, 122))),
        *_can((-2.35, 0.8, 3.72), 0.05, 0.16, 0.06, wood(rng, 30, 300, *WALNUT), lid),
        *_can((-2.35, 0.85, 3.72), 0.2, 0.035, 0.035, wood(rng, 60, 90, *WALNUT), lid),
        *_can((-2.35, 1.02, 3.72), 0.36, 0.27, 0.15, shade, lid),
    ]


def _balls(rng: np.random.Generator) -> list[RenderedSurface]:
    beach: tuple[Color, ...] = ((236, 232, 222), (206, 52, 44), (240, 190, 48), (34, 106, 168))
    green = marble(rng, 300, 600, _near(rng, (58, 118, 96), 16), (206, 226, 212))
    return [
        Sphere(_at(1.06, 0.24, 2.85), 0.24, _tilted(rng), stripes(rng, 300, 600, beach, 12)),
        Sphere(_at(-1.6, 0.63, 3.1), 0.19, _tilted(rng), globe(rng, 300, 600)),
        Sphere(_at(0.16, 0.13, 2.34), 0.13, _tilted(rng), green),
    ]


def _leaning(rng: np.random.Generator) -> list[RenderedSurface]:
    """Boards that lean against the wall and the pier."""
    ink: tuple[Color, ...] = ((24, 112, 122), (232, 120, 60), (246, 226, 190), (92, 48, 92))
    poster = abstract(rng, 520, 380, _near(rng, (236, 206, 150), 12), ink)
    plank = wood(rng, 560, 130, *PINE)
    return [
        Rectangle(_at(0.72, 1.0, WALL - 0.06), _at(0.68, 0, 0.0), _at(0, -0.99, -0.4), poster),
        Rectangle(_at(2.32, 1.35, WALL - 0.08), _at(0.3, 0, 0.02), _at(0.02, -1.34, -0.3), plank),
    ]


def _can(
    foot: tuple[float, float, float], height: float, lower: float, upper: float, side: Texture, top: Texture
) -> list[RenderedSurface]:
    x, y, z = foot
    lid = Rectangle(_at(x - upper, y + height, z + upper), _at(2 * upper, 0, 0), _at(0, 0, -2 * upper), top, round=True)
    return [Frustum(_at(x, y, z), height, lower, upper, side), lid]


def _at(x: float, y: float, z: float) -> NDArray[np.float64]:
    return np.array([x, y, z], np.float64)


def _tilted(rng: np.random.Generator) -> NDArray[np.float64]:
    axis = np.array([rng.uniform(-0.6, 0.6), 1.0, rng.uniform(-0.5, 0.2)])
    return np.asarray(axis / np.linalg.norm(axis))


def _near(rng: np.random.Generator, color: Color, spread: float) -> Color:
    r, g, b = (float(c + rng.uniform(-spread, spread)) for c in color)
    return r, g, b
