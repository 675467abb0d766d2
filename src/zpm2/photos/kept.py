"""What was found in single photographs, kept for the further pairs that they are part of."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import TypeVar, cast

from zpm2.model import Image

T = TypeVar("T")


@dataclass(eq=False)
class _Photo:
    image: Image
    found: dict[Hashable, object] = field(default_factory=dict)
    locks: dict[Hashable, threading.Lock] = field(default_factory=dict)  # of what is looked for


class KeptPhotos:
    """The `most` photographs that were used last, and what was found in each of them alone. Threads may share it."""

    def __init__(self, most: int = 0) -> None:
        self.most = most
        self._photos: OrderedDict[Hashable, _Photo] = OrderedDict()
        self._lock = threading.Lock()

    def same(self, image: Image) -> Image:
        """The kept photograph with the same content and path; `image` itself, which is kept now, where there is
        none."""
        if not self.most:
            return image
        key = _key(image)
        with self._lock:
            photo = self._photos.setdefault(key, _Photo(image))
            self._photos.move_to_end(key)
            while len(self._photos) > self.most:
                self._photos.popitem(last=False)
        return photo.image

    def found(self, image: Image, what: Hashable, find: Callable[[], T]) -> T:
        """What `find` finds in a photograph alone. It is called once for each `what` as long as the photograph (the
        same object, see `same`) is kept. A second thread waits."""
        with self._lock:
            photo = next((each for each in self._photos.values() if each.image is image), None)
        if photo is None:
            return find()
        with photo.locks.setdefault(what, threading.Lock()):
            if what not in photo.found:
                photo.found[what] = find()
            return cast(T, photo.found[what])


def _key(image: Image) -> Hashable:
    content = blake2b(image.rgb.tobytes(), digest_size=16)
    content.update(b"" if image.valid is None else image.valid.tobytes())
    return image.rgb.shape, image.path, image.notes, repr(image.geo), content.digest()


NOTHING_KEPT = KeptPhotos()
