"""The contract of a point matcher (`zpm2.features.protocol`), on pairs whose truth is known. A check takes a function
that gives the matcher for a largest side of images."""

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from zpm2.contract.check import Broken, expect
from zpm2.contract.scenes import (
    HOMOGRAPHY,
    grey,
    half_valid,
    in_threads,
    no_data,
    plane,
    texture,
    unchanged,
)
from zpm2.features.protocol import PointMatcher
from zpm2.geometry import project
from zpm2.model import Image, PointMatches

ENOUGH = 20  # points of a textured pair
SIZES = ((1, 1), (2, 3), (32, 32), (4000, 5), (5, 4000))  # px
SHIFT = 0.35  # px, the largest mean shift; half a pixel is what a frame with centres at 0 gives
SIDE = 1600  # px, the largest side at which images are looked at

Of = Callable[[int], PointMatcher]  # the matcher for a `PointsConfig.max_size`


def check_form(matches: object, left: Image, right: Image) -> PointMatches:
    """The matches of a pair. `Broken` where they are not as `PointMatcher.match` says."""
    what = f"match returns a {type(matches).__name__}: return zpm2.model.PointMatches(left, right, score)"
    expect(isinstance(matches, PointMatches), what)
    assert isinstance(matches, PointMatches)
    for name, points, image in (("left", matches.left, left), ("right", matches.right, right)):
        good = isinstance(points, np.ndarray) and points.dtype == np.float64 and points.shape == (len(matches), 2)
        expect(good, f"{name} points are no (n, 2) array of float64: use np.asarray(points, np.float64).reshape(-1, 2)")
        inside = bool(((points >= 0) & (points <= [image.width, image.height])).all())
        size = f"{image.width} x {image.height} px"
        expect(inside, f"{name} points lie outside of an image of {size}: x first, then y, in px of the image as given")
    score = matches.score
    good = isinstance(score, np.ndarray) and score.dtype == np.float64 and score.shape == (len(matches),)
    expect(good, "scores are no (n,) array of float64: one for each match")
    expect(bool(((score >= 0) & (score <= 1)).all()), "scores are not from 0 to 1: scale them")
    return matches


def has_a_name(of: Of) -> None:
    """`name` is a text."""
    matcher = of(SIDE)
    name = matcher.name
    expect(isinstance(name, str) and bool(name.strip()), "it has no name: give the class name = 'word'")


def finds_what_is_there(of: Of) -> None:
    """A textured plane and its view from the side: enough matches, and most of them right."""
    matcher = of(SIDE)
    left, right = plane()
    found = check_form(matcher.match(left, right), left, right)
    expect(len(found) >= ENOUGH, f"{len(found)} points in a textured pair: find at least {ENOUGH}")
    distance = np.linalg.norm(project(HOMOGRAPHY, found.left) - found.right, axis=1)
    good = (distance < 3).mean()
    expect(good > 0.5, f"{good:.0%} of the matches are within 3 px of the truth: more than half have to be")


def pixel_centres_are_at_half(of: Of) -> None:
    """No shift between an image and itself at half the size, which a frame with centres at 0 has. A matcher that keeps
    to `PointsConfig.max_size` sees both at the smaller size."""
    left = plane()[0]
    right = Image(cv2.resize(left.rgb, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    found = check_form(of(right.width).match(left, right), left, right)
    residual = found.left - 2 * found.right
    near = residual[np.linalg.norm(residual, axis=1) < 6]
    expect(
        len(near) >= ENOUGH,
        f"{len(near)} right points between an image and itself at half the size: find at least {ENOUGH}, or look at "
        "both with their longer sides at most config.max_size px",
    )
    shift = float(np.abs(near.mean(0)).max())
    expect(
        shift < SHIFT,
        f"points are off by {shift:.2f} px between an image and itself at half the size: pixel centres are at +0.5 "
        "(add 0.5 to what OpenCV and most networks give), in px of the image as given",
    )


def an_image_matches_itself(of: Of) -> None:
    """An image and itself: matches in place."""
    matcher = of(SIDE)
    image = plane()[0]
    found = matcher.match(image, image)
    expect(len(found) >= ENOUGH, f"{len(found)} points between an image and itself: find at least {ENOUGH}")
    shift = np.abs((found.left - found.right).mean(0)).max()
    expect(shift < 0.5, f"an image matches itself {shift:.2f} px off")


def same_bytes_twice(of: Of) -> None:
    """The same pair gives the same bytes, also when another pair came between."""
    matcher = of(SIDE)
    left, right = plane()
    first = _content(matcher.match(left, right))
    matcher.match(right, left)
    again = _content(matcher.match(left, right))
    expect(first == again, "the same pair gives other points, or another order, the second time: seed what is random")


def images_are_left_alone(of: Of) -> None:
    """The pixels that it is given stay as they are."""
    matcher = of(SIDE)
    for left, right in (plane(), (half_valid(plane()[0]), plane()[1])):
        unchanged([left, right], lambda a=left, b=right: matcher.match(a, b))  # type: ignore[misc]


def any_size(of: Of) -> None:
    """Images of one pixel, small, long and thin give points or none."""
    matcher = of(SIDE)
    for width, height in SIZES:
        image = Image(texture(width, height))
        _any(matcher, image, image, f"images of {width} x {height} px")


def nothing_to_see(of: Of) -> None:
    """Images of one colour, alone and beside another one: no points."""
    matcher = of(SIDE)
    other = Image(texture(64, 64))
    for value in (0, 127, 255):
        blank = grey(70, 60, value)
        for left, right in ((blank, blank), (blank, other), (other, blank)):
            found = _any(matcher, left, right, "an image of one colour")
            expect(len(found) == 0, f"{len(found)} points in an image of one colour: return PointMatches.empty()")


def no_data_is_no_error(of: Of) -> None:
    """Images with pixels that hold no data (`image.valid`), and without any that do."""
    matcher = of(SIDE)
    left, right = plane()
    for image in (half_valid(left), no_data(left)):
        _any(matcher, image, right, "an image with pixels that hold no data")


def many_pairs(of: Of) -> None:
    """`match_many` gives a result for each pair, in their order; none for none."""
    matcher = of(SIDE)
    left, right = plane()
    crops = [
        (Image(left.rgb[:96, :128].copy()), Image(right.rgb[:96, :128].copy())),
        (grey(40, 30, 99), grey(40, 30, 99)),
        (Image(left.rgb[80:200, 100:260].copy()), Image(left.rgb[80:200, 100:260].copy())),
    ]
    found = matcher.match_many(crops)
    expect(len(found) == len(crops), f"match_many gives {len(found)} results for {len(crops)} pairs: one for each")
    for pair, matches in zip(crops, found, strict=True):
        check_form(matches, *pair)
    expect(len(found[1]) == 0, "match_many finds points between blank images, or mixes the pairs up")
    expect(list(matcher.match_many([])) == [], "match_many of no pairs gives something: return []")


def threads_take_turns(of: Of) -> None:
    """Two threads that use it in turn get what one gets."""
    matcher = of(SIDE)
    alone = _content(matcher.match(*plane()))
    for found in in_threads(lambda pair: matcher.match(*pair), [plane(), plane()]):
        expect(_content(found) == alone, "another thread gets other points: keep no state of a thread between pairs")


def _any(matcher: PointMatcher, left: Image, right: Image, what: str) -> PointMatches:
    try:
        found = matcher.match(left, right)
    except Exception as error:
        told = " ".join(str(error).split())
        raise Broken(f"{what}: raises {type(error).__name__}: {told}; return PointMatches.empty()") from error
    return check_form(found, left, right)


def _content(matches: PointMatches) -> tuple[bytes, bytes, bytes]:
    return matches.left.tobytes(), matches.right.tobytes(), matches.score.tobytes()


CHECKS: Mapping[str, Callable[[Of], None]] = {
    "has a name": has_a_name,
    "finds what is there": finds_what_is_there,
    "has pixel centres at +0.5": pixel_centres_are_at_half,
    "matches an image to itself": an_image_matches_itself,
    "gives the same bytes twice": same_bytes_twice,
    "leaves the images alone": images_are_left_alone,
    "takes images of any size": any_size,
    "finds nothing where nothing is": nothing_to_see,
    "takes images without data": no_data_is_no_error,
    "matches many pairs": many_pairs,
    "works in threads that take turns": threads_take_turns,
}
