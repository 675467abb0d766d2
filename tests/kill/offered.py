"""The weights that a command under test is offered. Each run imports this, so it imports little."""

import sys
from contextlib import ExitStack
from pathlib import Path
from unittest import mock


def offered(words: list[str]) -> ExitStack:
    """In the process of a command about weights: a manifest of one small file, which a server on the loopback
    interface offers."""
    stack = ExitStack()
    if words[:1] == ["weights"]:
        sys.path.append(str(Path(__file__).parents[1] / "weights"))
        import loopback

        item = loopback.tiny(loopback.HUB)
        for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
            __import__(module)
            stack.enter_context(mock.patch(f"{module}.MANIFEST", (item,)))
    return stack
