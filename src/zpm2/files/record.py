"""The record of what runs of zpm2 made in an output folder, so that nothing else is ever replaced or removed.

A claimed output folder has a hidden folder `.zpm2` for all temporary files and for the record, `made.jsonl`: a line for
the format, then a line for each file and folder that was made, written before the file takes its name. In and below a
claimed folder, a file is only replaced or removed if it is on this record and was not changed since. An output folder
that was not claimed has no record; there the caller decides.
"""

import contextlib
import json
import os
import shutil
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

from zpm2.errors import OutputError
from zpm2.files.keys import fingerprint
from zpm2.files.lock import AlreadyLocked, locked
from zpm2.files.reading import WRONG, parse_json

HIDDEN = ".zpm2"
RECORD = "made.jsonl"
LOCK = "lock"  # of the run that is at work
TILES = f"{HIDDEN}/tiles"  # of an interrupted run
KEYS = f"{HIDDEN}/keys"  # of finished results
FORMAT = {"format": "zpm2-folder/1"}
FOLDER = "folder"  # in place of a fingerprint


def create_record(folder: Path) -> None:
    """Starts the record of a folder, unless it lies in one that is on a record.

    Also removes what killed runs left. `OutputError` if the hidden folder's name is taken by something else; `OSError`.
    """
    home = _home(folder / HIDDEN)
    if home is None or (home != _absolute(folder) and not _lies_in_made(folder, home)):
        hidden = folder / HIDDEN
        if os.path.lexists(hidden) and (hidden.is_symlink() or not hidden.is_dir() or any(hidden.iterdir())):
            raise OutputError(f"{hidden} is not the folder that zpm2 keeps its files in: give another output folder")
        hidden.mkdir(exist_ok=True)
        _append(hidden / RECORD, FORMAT)
        return
    remove_leftovers(_parts(home))


@contextlib.contextmanager
def only_run(folder: Path) -> Iterator[None]:
    """Locks a claimed folder against other runs. `OutputError` where another run is at work in it; `OSError`."""
    home = _home(folder / HIDDEN)
    if home is None:
        yield
        return
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(locked(home / HIDDEN / LOCK))
        except AlreadyLocked:
            raise OutputError(
                f"another run is writing into {folder}: wait until it ends, or give another output folder"
            ) from None
        yield


def remove_record(folder: Path) -> None:
    """Removes the hidden folder if nothing on the record exists any more and nothing is kept for a later run."""
    hidden = folder / HIDDEN
    if _home(hidden) != _absolute(folder):
        return
    there = [name for name in _made(folder) if os.path.lexists(folder / name)]
    if not there and not any(path.name not in (RECORD, "parts", "keys") for path in hidden.iterdir()):
        _remove(hidden)


def refuse_foreign(path: Path) -> None:
    """`OutputError` if a claimed folder has something of that name that no run made, or that was changed since.

    An empty folder is allowed.
    """
    home = _home(path)
    if home is None or not os.path.lexists(path) or _is_own(path, home):
        return
    plain = not path.is_symlink()
    if plain and path.is_dir() and not any(path.iterdir()):
        return
    known = _made(home).get(_name(path, home), set())
    if plain and (FOLDER in known if path.is_dir() else path.is_file() and fingerprint(path) in known):
        return
    what = "was changed since zpm2 wrote it" if known else "is there already, and is not on record as made by zpm2"
    raise OutputError(f"{path} {what}: move it away, or give another output folder")


def move_into_place(part: Path, target: Path) -> Path:
    """Moves a finished file or folder to its final name, replacing one that an earlier run made, and records it."""
    refuse_foreign(target)
    home = _home(target)
    if home is not None and not _is_own(target, home):
        for path in (part, *part.rglob("*")) if part.is_dir() else (part,):
            _remember(home, target / path.relative_to(part), FOLDER if path.is_dir() else fingerprint(path))
    os.replace(part, target)
    return target


def make_folder(path: Path) -> Path:
    """A recorded folder, made if it is not there. `OutputError` where no run made it, or it cannot be made."""
    try:
        refuse_foreign(path)
        home = _home(path)
        if home is not None and not _is_own(path, home) and FOLDER not in _made(home).get(_name(path, home), ()):
            _remember(home, path, FOLDER)
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {path}: {error.strerror}") from error
    return path


def save_key(folder: Path, key: str) -> None:
    """Stores the key (`keys.key`) of the finished results in a recorded folder. `OutputError`."""
    file = _key_file(folder)
    if file is None:
        return
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(key, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write {file}: {error.strerror}") from error


def saved_key(folder: Path) -> str | None:
    """The key that `save_key` remembered."""
    file = _key_file(folder)
    return file.read_text(encoding="utf-8", errors="replace") if file is not None and file.is_file() else None


def remove_own(path: Path) -> None:
    """Removes a file that a run made, or a file or folder inside the hidden folder, if it is there."""
    home = _home(path)
    if path.is_dir() and not (home is not None and _is_own(path, home)):
        raise OutputError(f"{path} is a folder that others may have put files into: it is not removed")
    refuse_foreign(path)
    _remove(path)


def remove_made(folder: Path, name: str = "") -> None:
    """Removes what runs made in a claimed folder, at `name` in it or below: files that nobody changed since, and
    folders that are empty then. What lies in another claimed folder in it stays."""
    home, place = _home(folder / HIDDEN), _absolute(folder) / name
    if home is None or not os.path.lexists(place):
        return
    for each, known in sorted(_made(home).items(), reverse=True):  # what is in a folder before it
        path = home / each
        if not path.is_relative_to(place):
            continue
        with contextlib.suppress(OSError):  # not there, or not empty
            if FOLDER in known and path.is_dir() and not path.is_symlink():
                path.rmdir()
            elif path.is_file() and fingerprint(path) in known:
                path.unlink()


@contextlib.contextmanager
def temporary_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder for files that will be moved into `folder`, on the same disk; always removed at the end.

    It lies in the hidden folder of a claimed folder, else in `folder` itself. `OSError` where it cannot be made.
    """
    home = _home(folder / HIDDEN)
    parent = folder
    if home is not None:
        parent = _parts(home)
        parent.mkdir(exist_ok=True)
    # The name is known before the folder is there: an interrupt in between leaves nothing.
    path = parent / f"{'' if home else '.'}{os.getpid()}-{uuid.uuid4().hex}.part"
    try:
        path.mkdir(mode=0o700)
        yield path
    finally:
        try:
            _remove(path)
        except KeyboardInterrupt:  # half-way
            _remove(path)
            raise


def staged(part: Path, folder: Path) -> Path:
    """A folder in a temporary one `part`, made for files that are to be moved into `folder`."""
    home = _home(folder / HIDDEN)
    made = part if home is None else part / _name(folder, home)
    made.mkdir(parents=True, exist_ok=True)
    return made


def destination(folder: Path) -> Path:
    """Where the files of a `staged` folder will lie; any other folder as it is."""
    home = _home(folder)
    if home is None or not _absolute(folder).is_relative_to(_parts(home)):
        return folder
    return home.joinpath(*Path(_name(folder, home)).parts[3:])  # of .zpm2/parts/NAME.part/


def remove_scratch(folder: Path) -> None:
    """Removes the temporary folders of this process in a claimed folder, where an interrupt kept `temporary_folder`
    from cleaning up."""
    with contextlib.suppress(OSError):  # no such folder, or none of that name can be
        for part in _parts(folder).glob(f"{os.getpid()}-*.part"):
            _remove(part)


def remove_leftovers(folder: Path) -> None:
    """Removes the temporary folders of killed runs in a folder that only zpm2 writes to."""
    for part in folder.glob("*.part"):
        process = part.name.lstrip(".").partition("-")[0]
        if process.isdecimal() and not _alive(int(process)):
            _remove(part)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


def _home(path: Path) -> Path | None:
    """The nearest claimed folder around a path."""
    return next((folder for folder in _absolute(path).parents if os.path.isfile(folder / HIDDEN / RECORD)), None)


def _made(home: Path) -> dict[str, set[str]]:
    """The record of a claimed folder: fingerprints by name. A line that a killed run did not finish does not count."""
    file = home / HIDDEN / RECORD
    made: dict[str, set[str]] = {}
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    if lines and lines[0] != json.dumps(FORMAT):  # without a line where a run was killed before it wrote one
        raise OutputError(f"{file} is not a record of zpm2: give another output folder")
    for line in lines[1:]:
        with contextlib.suppress(*WRONG):
            values = parse_json(line.encode())
            made.setdefault(str(values["name"]), set()).add(str(values["is"]))
    return made


def _remember(home: Path, path: Path, what: str) -> None:
    _append(home / HIDDEN / RECORD, {"name": _name(path, home), "is": what})


def _append(record: Path, values: dict[str, str]) -> None:
    """Adds a line, after the one for the format, and not to one that a killed run did not finish."""
    with record.open("a+b") as file:
        end = file.seek(0, os.SEEK_END)
        lines = [] if end or values is FORMAT else [FORMAT]
        file.seek(max(end - 1, 0))
        unfinished = file.read() not in (b"", b"\n")
        text = "\n" * unfinished + "".join(json.dumps(line) + "\n" for line in [*lines, values])
        file.write(text.encode())


def _key_file(folder: Path) -> Path | None:
    home = _home(folder)
    return None if home is None else home / KEYS / _name(folder, home) / "key"


def _lies_in_made(folder: Path, home: Path) -> bool:
    """Whether a folder is the hidden one, or on the record, or lies in such a one."""
    made, name = _made(home), Path(_name(folder, home))
    return _is_own(folder, home) or any(FOLDER in made.get(p.as_posix(), ()) for p in (name, *name.parents))


def _is_own(path: Path, home: Path) -> bool:
    return Path(_name(path, home)).parts[:1] == (HIDDEN,)


def _name(path: Path, home: Path) -> str:
    return _absolute(path).relative_to(home).as_posix()


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))


def _parts(home: Path) -> Path:
    return home / HIDDEN / "parts"


def _alive(process: int) -> bool:
    """Whether a process is still running, so that its files must stay.

    On Windows, the answer is not needed: open files cannot be removed there. It has no harmless signal to ask with.
    """
    if sys.platform == "win32":
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True
