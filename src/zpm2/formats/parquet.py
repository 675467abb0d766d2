"""The package that reads and writes Parquet (extra `parquet`)."""

from types import ModuleType

from zpm2.errors import MissingDependency


def require_pyarrow(who: str) -> ModuleType:
    """The package, or `MissingDependency`, which says who needs it."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise MissingDependency(f'{who} needs pyarrow: pip install "zpm2[parquet]"') from error
    return pyarrow
