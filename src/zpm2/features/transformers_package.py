"""The package `transformers`, of which some matchers take their networks (extra `hf`)."""

import logging
from types import ModuleType

from zpm2.errors import MissingDependency


def transformers(method: str) -> ModuleType:
    """The package, or `MissingDependency`. Of its many warnings only errors are let through."""
    try:
        import transformers as package
    except ImportError as error:
        raise MissingDependency(f'{method} needs transformers: pip install "zpm2[hf]"') from error
    logging.getLogger("transformers").setLevel(logging.ERROR)
    return package
