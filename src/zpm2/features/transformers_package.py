"""The package `transformers`, of which some matchers take their networks (extra `hf`)."""

import logging
from types import ModuleType


def transformers() -> ModuleType:
    """The package. Of its many warnings only errors are let through."""
    import transformers as package

    logging.getLogger("transformers").setLevel(logging.ERROR)
    return package
