import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from zpm2.model import Image
from zpm2.photos.kept import NOTHING_KEPT, Form, KeptPhotos
from zpm2.photos.shelf import Shelf


def image(value: int, path: str | None = None, valid: bool = True) -> Image:
    return Image(np.full((4, 5, 3), value, np.uint8), path, (), None if valid else np.zeros((4, 5), bool))


def test_a_photograph_with_the_same_content_is_the_same_one() -> None:
    kept, first = KeptPhotos(3), image(1)
    assert kept.same(first) is first
    assert kept.same(image(1)) is first
    for other in (image(2), image(1, "a.png"), image(1, valid=False)):
        assert kept.same(other) is other


def test_only_the_last_ones_are_kept() -> None:
    kept, first, second = KeptPhotos(2), image(1), image(2)
    for each in (first, second, image(1), image(3)):
        kept.same(each)
    assert kept.same(image(1)) is first
    assert kept.same(image(2)) is not second


def test_what_was_found_is_not_looked_for_again() -> None:
    kept, photo = KeptPhotos(2), image(1)
    calls = []
    kept.same(photo)
    for what in ("a", "a", "b"):
        assert kept.found(photo, what, lambda what=what: calls.append(what) or what) == what
    assert calls == ["a", "b"]
    for of, what in ((kept, image(1)), (NOTHING_KEPT, photo)):  # one that is not kept is asked each time
        assert [of.found(what, "a", lambda: calls.append("c") or "c") for _ in range(2)] == ["c", "c"]
    assert calls == ["a", "b", "c", "c", "c", "c"]


def test_what_was_found_in_others_comes_from_the_shelf(tmp_path):
    kept, calls = KeptPhotos(2, Shelf(tmp_path, 100)), []
    form = Form(lambda value: {"value": np.array(value)} if value != 3 else None, lambda arrays: int(arrays["value"]))

    def look(value: int, what: str, form: Form[int] | None) -> int:
        return kept.found(kept.same(image(value)), what, lambda: calls.append((what, value)) or value, form)

    for value in (1, 2, 3, 4, 1, 2, 3, 4, 1):
        assert look(value, "a", form) == value
        assert look(value, "b", None) == value
    assert calls.count(("a", 3)) == calls.count(("b", 4)) == 2  # not written
    assert calls.count(("b", 1)) == 3
    assert [call for call in calls if call[0] == "a"] == [("a", value) for value in (1, 2, 3, 4, 3)]


def test_nothing_is_remembered_of_what_failed() -> None:
    kept, photo = KeptPhotos(2), image(1)
    kept.same(photo)
    for answer in (0, 1):
        try:
            assert kept.found(photo, "a", lambda: 1 // answer) == 1  # noqa: B023
        except ZeroDivisionError:
            assert not answer


def test_threads_look_once() -> None:
    kept, photo, calls = KeptPhotos(2), image(1), []
    kept.same(photo)
    ready = threading.Barrier(4)

    def find() -> int:
        calls.append(1)
        time.sleep(0.02)
        return len(calls)

    def ask(_: int) -> int:
        ready.wait()
        return kept.found(photo, "a", find)

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(ask, range(4))) == [1, 1, 1, 1]
