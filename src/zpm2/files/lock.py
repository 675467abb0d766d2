"""One run at a time: an advisory lock on a file. The system releases it when the process ends, however it ends."""

import contextlib
import errno
import logging
import os
import sys
from collections.abc import Iterator
from pathlib import Path

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

TAKEN = (errno.EACCES, errno.EAGAIN)  # by another process: Windows, others

_log = logging.getLogger(__name__)


class AlreadyLocked(Exception):
    """Another process holds the lock."""


@contextlib.contextmanager
def locked(file: Path) -> Iterator[None]:
    """Creates a file, locks it, and removes it afterwards.

    `AlreadyLocked` immediately if another process, or an enclosing call, holds the lock; `OSError` if the file cannot
    be created. A file left by a killed process locks nothing. On disks without locks, such as some network drives,
    nothing is locked and a warning is logged.
    """
    opened = _opened(file)
    try:
        yield
    finally:
        if sys.platform != "win32":  # while it is ours: later another run may have made it
            file.unlink(missing_ok=True)
        os.close(opened)
        if sys.platform == "win32":  # where only what nobody has open can be removed
            with contextlib.suppress(OSError):
                file.unlink()


def _opened(file: Path) -> int:
    while True:
        opened = os.open(file, os.O_RDWR | os.O_CREAT)
        try:
            _take(opened)
            if os.path.lexists(file) and os.path.samestat(os.fstat(opened), os.stat(file)):
                return opened
        except OSError as error:
            if error.errno not in TAKEN:
                _log.warning("%s cannot be locked (%s): let no other run write there", file.parent, error.strerror)
                return opened
            os.close(opened)
            raise AlreadyLocked from error
        os.close(opened)  # another run ended in between, and its file with it


def _take(opened: int) -> None:
    if sys.platform == "win32":
        msvcrt.locking(opened, msvcrt.LK_NBLCK, 1)
    else:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
