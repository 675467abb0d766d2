"""Addresses that fsspec knows (s3://, gs://, memory://, ...), for lists and results. Photographs are local files."""

from typing import TYPE_CHECKING

from zpm2.errors import InputError, MissingDependency, OutputError

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem


def is_address(text: str) -> bool:
    """Whether a place is an address and no path."""
    return "://" in text


def opened(address: str) -> "tuple[AbstractFileSystem, str]":
    """The file system of an address and the path in it. `MissingDependency` without fsspec or what it needs for this
    one, `InputError` for an address that it does not know."""
    try:
        import fsspec
    except ModuleNotFoundError as error:
        raise MissingDependency(f'{address} needs fsspec: pip install "zpm2[remote]"') from error
    try:
        system, path = fsspec.core.url_to_fs(address)
        return system, str(path)
    except ImportError as error:
        raise MissingDependency(f"{address} needs a package of its own: {error}") from error
    except Exception as error:  # whatever the package of a store may raise
        raise InputError(f"{address} is no address that fsspec can open: {error}") from error


def read(address: str) -> bytes:
    """The content of a file. `InputError` where it cannot be read."""
    system, path = opened(address)
    try:
        return bytes(system.cat_file(path))
    except Exception as error:  # whatever the package of a store may raise
        raise InputError(f"cannot read {address}: {type(error).__name__} {error}") from error


def write(address: str, content: bytes) -> None:
    """Writes a file; stores show it when it is whole. `OutputError` where it cannot be written."""
    system, path = opened(address)
    try:
        system.makedirs(path.rpartition("/")[0], exist_ok=True)  # stores of objects need none
        system.pipe_file(path, content)
    except Exception as error:  # whatever the package of a store may raise
        raise OutputError(f"cannot write {address}: {type(error).__name__} {error}") from error


def remove(address: str) -> None:
    """Removes a folder, if it is there. `OutputError` where that fails."""
    system, path = opened(address)
    try:
        if system.exists(path):
            system.rm(path, recursive=True)
    except Exception as error:  # whatever the package of a store may raise
        raise OutputError(f"cannot remove {address}: {type(error).__name__} {error}") from error
