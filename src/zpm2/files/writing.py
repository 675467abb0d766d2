"""Files written whole or not at all, into a folder that was tested before the work began."""

import contextlib
import errno
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from zpm2.errors import OutputError
from zpm2.files import record

ON_WRITING = {  # errors that only writing can meet, and what to do
    errno.ENOSPC: "the disk is full; free some space",
    getattr(errno, "EDQUOT", -1): "your share of the disk is full; free some space",
    errno.EROFS: "permission denied, the disk can only be read; give a folder on another one",
    errno.EFBIG: "a file would be larger than allowed; raise the limit (ulimit -f), or give another disk",
}


def atomic_write(path: str | Path, content: bytes | str) -> Path:
    """Writes `content` (text as UTF-8) so that `path` holds all of it, or what it held before.

    The bytes go to a temporary file, which then takes the name. Returns the path. `OutputError` when the folder does
    not exist or is not writable, `path` is a folder, the disk is full, or, in a claimed folder (`claim`), `path` is a
    file that zpm2 did not write; no temporary file stays.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    try:
        with record.temporary_folder(path.parent) as folder:
            part = folder / "part"
            part.write_bytes(data)
            record.move_into_place(part, path)
    except OSError as error:
        path = record.destination(path.parent) / path.name
        raise OutputError(f"cannot write {path}: {why(error, path)}") from error
    return path


@contextlib.contextmanager
def replaced_together(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """A temporary folder for those files and folders `names` of a claimed folder that a run makes. At the end they take
    the place of all those that earlier runs made.

    The last name, whose file says that all are there, is removed first and comes last. `OutputError` as from
    `atomic_write`; where it comes before the end, `folder` is as it was.
    """
    target = folder
    try:
        with record.temporary_folder(folder) as part:
            made = record.staged(part, folder)
            yield made
            parts = sorted(made.rglob("*"), key=lambda path: (path.name == names[-1], path))
            for each in parts:
                record.refuse_foreign(folder / each.relative_to(made))
            for name in reversed(names):
                record.remove_made(folder, name)
            for each in parts:
                target = folder / each.relative_to(made)
                record.make_folder(target) if each.is_dir() else record.move_into_place(each, target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {why(error, target)}") from error


def check_place(path: Path) -> None:
    """`OutputError` where `atomic_write` could not write a file, so that a long run does not fail at its end."""
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        record.refuse_foreign(path)
        with record.temporary_folder(path.parent):
            pass
    except OSError as error:
        raise OutputError(f"cannot write {path}: {why(error, path)}") from error


def output_folder(path: str | Path, inputs: Iterable[str | Path] = ()) -> Path:
    """The folder for results, created if missing, and tested for writing, so that a long run does not fail at its end.

    `OutputError` if `path` is a file (one of `inputs`, for instance), cannot be created, or cannot be written into.
    """
    path = Path(path)
    for source in inputs:
        if _same(path, Path(source)):
            raise OutputError(f"output folder {path} is one of the input files: give another folder")
    try:
        str(path).encode()
        if path.exists() and not path.is_dir():
            raise OutputError(f"output folder {path} is a file: give another folder")
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path) as file:
            file.write(b"\0")
    except OSError as error:
        raise OutputError(f"cannot write into output folder {path}: {why(error, path)}") from error
    except ValueError as error:  # a NUL, or what no file of text can hold
        raise OutputError(f"output folder {path} has a name that is not UTF-8: give another folder") from error
    return path


def claim(path: str | Path, names: Iterable[str], inputs: Iterable[str | Path] = ()) -> Path:
    """The output folder (`output_folder`) of a caller who will write the files and folders `names` there.

    From now on, only files and folders that a run of zpm2 made are replaced in it (`record`). `OutputError` if one of
    the names is taken by something else, by something that was changed since, or by one of `inputs`.
    """
    sources = [Path(source) for source in inputs]
    folder = output_folder(path, sources)
    try:
        record.create_record(folder)
        for target in (folder / name for name in names):
            record.refuse_foreign(target)
            if any(_holds(target, source) for source in sources):
                raise OutputError(f"{target} is an input and would be written over: give another output folder")
    except OSError as error:
        record.remove_record(folder)
        raise OutputError(f"cannot write into output folder {folder}: {why(error, folder)}") from error
    except OutputError:
        record.remove_record(folder)
        raise
    return folder


@contextlib.contextmanager
def results_folder(path: Path, names: Iterable[str], inputs: Iterable[Path] = ()) -> Iterator[Path]:
    """Claims a folder and locks it for one run. If the run ends early and has written nothing, the folder is removed
    again.

    `OutputError` as from `claim`, if another run is at work in the folder, and for a full or read-only disk, at any
    point of the run.
    """
    fresh = [folder for folder in (path, *path.parents) if not os.path.lexists(folder)]
    try:
        folder = claim(path, names, inputs)
        with record.only_run(folder):
            yield folder
    except BaseException as error:
        record.remove_scratch(path)
        record.remove_record(path)
        for folder in fresh:
            with contextlib.suppress(OSError):  # not empty
                folder.rmdir()
        if isinstance(error, OSError) and error.errno in ON_WRITING:
            raise OutputError(f"cannot write into output folder {path}: {why(error, path)}") from error
        raise


def _holds(target: Path, source: Path) -> bool:
    """Whether writing to `target` would overwrite the input `source`."""
    return _same(target, source) or (target.is_dir() and target.resolve() in source.resolve().parents)


def _same(a: Path, b: Path) -> bool:
    try:
        return a.samefile(b)
    except OSError:
        return False


def stops_all(error: OutputError) -> bool:
    """Whether nothing more can be written, as the disk is full or can only be read."""
    return isinstance(error.__cause__, OSError) and error.__cause__.errno in ON_WRITING


def why(error: OSError, path: Path) -> str:
    """Why `path` could not be written and what to do, for the end of an `OutputError`'s line."""
    if error.errno in ON_WRITING:
        return ON_WRITING[error.errno]
    if error.errno in (errno.EACCES, errno.EPERM):
        held = ", and close programs that have the file open" if sys.platform == "win32" else ""
        return f"permission denied; give a folder that you may write to{held}"
    if error.errno == errno.ENAMETOOLONG:
        return "the name is too long; give a shorter one"
    if error.errno in (errno.ENOTDIR, errno.EEXIST):
        return "a part of the path is a file, not a folder; give another path"
    if error.errno in (errno.EISDIR, errno.ENOTEMPTY):
        return "there is a folder of that name; give another path"
    if error.errno == errno.ENOENT and os.path.isdir(path.parent):
        return "it cannot be created there; give another path"
    if error.errno == errno.ENOENT:
        return f"the folder {path.parent} does not exist; create it first"
    return (error.strerror or str(error)).lower()
