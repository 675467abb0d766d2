"""The public names and how they are called, as `public_api.txt` lists them.

A change of the list is a change for everybody who uses zpm2: make it on purpose, note it in CHANGELOG.md, and write the
list anew with `python tests/test_public_api.py`.
"""

import difflib
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from zpm2 import __version__

LIST = Path(__file__).with_name("public_api.txt")
MODULES = (  # those that the README and the docs speak of
    *("zpm2", "zpm2.config", "zpm2.errors", "zpm2.model", "zpm2.result", "zpm2.features", "zpm2.baselines"),
    *("zpm2.pose", "zpm2.cloud", "zpm2.reconstruct", "zpm2.evaluate", "zpm2.weights"),
)
PLAIN = (bool, int, float, str, tuple, type(None))


def listing() -> str:
    """All public names, with parameters and defaults but without types, which each Python prints in its own way."""
    return "\n".join(line for module in MODULES for line in _module(module)) + "\n"


def _module(name: str) -> Iterator[str]:
    module = import_module(name)
    names = getattr(module, "__all__", None) or [n for n in vars(module) if _is_own(module, n)]
    yield f"[{name}]"
    for public in sorted(names):  # docs/configuration.md lists the stages of the configuration, with a test of its own
        if public != "__version__" and not (name == "zpm2.config" and public.endswith("Config")):
            yield from _described(public, getattr(module, public))
    yield ""


def _is_own(module: Any, name: str) -> bool:
    return not name.startswith("_") and getattr(getattr(module, name), "__module__", None) == module.__name__


def _described(name: str, thing: Any) -> Iterator[str]:
    if inspect.ismodule(thing):
        yield f"{name}: module"
    elif inspect.isclass(thing):
        yield f"class {name}{_parameters(thing)}"
        members = ((n, m) for n, m in vars(thing).items() if not n.startswith("_") or n == "__call__")
        for member, value in sorted(members):
            if isinstance(value, property) or type(value).__name__ == "cached_property":
                yield f"    {member}"
            elif isinstance(value, staticmethod | classmethod) or inspect.isfunction(value):
                yield f"    {member}{_parameters(getattr(thing, member))}"
    elif inspect.isfunction(thing):
        yield f"{name}{_parameters(thing)}"
    else:
        yield f"{name}: value"


def _parameters(thing: Any) -> str:
    if inspect.isclass(thing) and (issubclass(thing, BaseException) or getattr(thing, "_is_protocol", False)):
        return ""
    signature = inspect.signature(thing)
    plain = [
        parameter.replace(annotation=inspect.Parameter.empty, default=_default(parameter.default))
        for parameter in signature.parameters.values()
        if parameter.name != "self"
    ]
    return str(signature.replace(parameters=plain, return_annotation=inspect.Signature.empty))


class _Elsewhere:
    """A default that has no short text."""

    def __repr__(self) -> str:
        return "..."


def _default(value: Any) -> Any:
    simple = value is inspect.Parameter.empty or (isinstance(value, PLAIN) and value != __version__)
    return value if simple and len(repr(value)) < 60 else _Elsewhere()


def test_public_names_change_on_purpose_only() -> None:
    before, now = LIST.read_text(encoding="utf-8").splitlines(), listing().splitlines()
    changes = "\n".join(difflib.unified_diff(before, now, "public_api.txt", "the package", lineterm="", n=0))
    assert not changes, f"{changes}\nIf that is on purpose: python tests/test_public_api.py"


if __name__ == "__main__":
    LIST.write_text(listing(), encoding="utf-8")
