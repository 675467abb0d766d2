"""What was found in single photographs, kept for the further pairs that they are part of."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import partial
from hashlib import blake2b
from typing import Generic, TypeVar, cast

from zpm2.errors import ConfigError
from zpm2.model import Image
from zpm2.photos.shelf import Arrays, Shelf

T = TypeVar("T")


@dataclass(frozen=True)
class Form(Generic[T]):
    """How something that was found is written as arrays, and read again without any difference."""

    arrays: Callable[[T], Arrays | None]  # None: it cannot be written
    value: Callable[[Arrays], T]


@dataclass(eq=False)
class _Photo:
    key: Hashable
    image: Image
    found: dict[Hashable, object] = field(default_factory=dict)
    written: dict[Hashable, Callable[[], Arrays | None]] = field(default_factory=dict)  # of what has a form
    locks: dict[Hashable, threading.Lock] = field(default_factory=dict)  # of what is looked for


class KeptPhotos:
    """The `most` photographs that were used last, and what was found in each of them alone. Threads may share it.

    What was found in the others goes on the `shelf`, where there is one, as far as it has a `Form`. `ConfigError` for
    less than 0 photographs.
    """

    def __init__(self, most: int = 0, shelf: Shelf | None = None) -> None:
        if most < 0:
            raise ConfigError(f"photographs to keep must be at least 0, got {most}")
        self.most, self.shelf = most, shelf
        self._photos: OrderedDict[Hashable, _Photo] = OrderedDict()
        self._lock = threading.Lock()

    def same(self, image: Image) -> Image:
        """The kept photograph with the same content and path; `image` itself, which is kept now, where there is
        none."""
        if not self.most:
            return image
        key = _key(image)
        with self._lock:
            photo = self._photos.setdefault(key, _Photo(key, image))
            self._photos.move_to_end(key)
            while len(self._photos) > self.most:
                self._put_aside(self._photos.popitem(last=False)[1])
        return photo.image

    def found(self, image: Image, what: Hashable, find: Callable[[], T], form: Form[T] | None = None) -> T:
        """What `find` finds in a photograph alone. It is called once for each `what` as long as the photograph (the
        same object, see `same`) is kept, or what was found lies on the shelf, in that `form`. A second thread waits."""
        with self._lock:
            photo = next((each for each in self._photos.values() if each.image is image), None)
        if photo is None:
            return find()
        with photo.locks.setdefault(what, threading.Lock()):
            if what not in photo.found:
                arrays = self.shelf.get((photo.key, what)) if self.shelf and form else None
                value = form.value(arrays) if form and arrays is not None else find()
                photo.found[what] = value
                if form:
                    photo.written[what] = partial(form.arrays, value)
            return cast(T, photo.found[what])

    def _put_aside(self, photo: _Photo) -> None:
        if self.shelf is None:
            return
        for what, written in photo.written.items():
            if (arrays := written()) is not None:
                self.shelf.put((photo.key, what), arrays)


def _key(image: Image) -> Hashable:
    content = blake2b(image.rgb.tobytes(), digest_size=16)
    content.update(b"" if image.valid is None else image.valid.tobytes())
    return image.rgb.shape, image.path, image.notes, repr(image.geo), content.digest()


NOTHING_KEPT = KeptPhotos()
