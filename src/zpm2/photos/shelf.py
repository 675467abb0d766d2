"""Arrays that a run puts aside on disk, byte for byte, until it needs them again."""

from collections.abc import Hashable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import OutputError
from zpm2.files.reading import read_arrays
from zpm2.files.writing import why

Arrays = Mapping[str, NDArray[np.generic]]


class Shelf:
    """Arrays by key, as files of a folder that is the run's own. They have `most` bytes together: what would be more is
    not taken, so that where everything is needed in turns, a part of it stays."""

    def __init__(self, folder: Path, most: float) -> None:
        self.folder, self.most = folder, most
        self.taken = 0  # bytes
        self._files: dict[Hashable, Path] = {}

    def put(self, key: Hashable, arrays: Arrays) -> None:
        """Writes the arrays, once for each key. `OutputError` where the disk does not take them."""
        size = sum(array.nbytes for array in arrays.values())
        if key in self._files or self.taken + size > self.most:
            return
        file = self.folder / f"{len(self._files)}.npz"
        try:
            np.savez(file, allow_pickle=False, **arrays)
        except OSError as error:
            raise OutputError(f"cannot write {file}: {why(error, file)}") from error
        self._files[key] = file
        self.taken += size

    def get(self, key: Hashable) -> Arrays | None:
        """The arrays of that key; None where it has none, or somebody removed them."""
        file = self._files.get(key)
        try:
            return None if file is None else {name: array.copy() for name, array in read_arrays(file).items()}
        except (OSError, ValueError):
            return None
