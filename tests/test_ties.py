"""Of equals the first comes first: no sort in the package may put them in an order of its own."""

import ast
from pathlib import Path

import pytest

import zpm2

FILES = sorted(Path(zpm2.__file__).parent.rglob("*.py"))
UNSTABLE = {"argpartition", "topk", "nlargest", "listdir", "scandir"}  # ties, or the file system's order


def loose(tree: ast.AST) -> list[str]:
    """Calls, as source, whose result may hang on more than their input."""
    found = []
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if isinstance(call.func, ast.Attribute):
            stable = {"kind", "stable"} & {keyword.arg for keyword in call.keywords}
            if call.func.attr in UNSTABLE or (call.func.attr == "argsort" and not stable):
                found.append(ast.unparse(call))
    return found


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(FILES[0].parent)))
def test_sorts_are_stable(file: Path) -> None:
    assert loose(ast.parse(file.read_text(encoding="utf-8"))) == []


def test_loose_calls_are_found() -> None:
    calls = "np.argsort(x)", "np.argsort(x, kind='stable')", "torch.topk(x, 3)"
    assert loose(ast.parse("\n".join(calls))) == [calls[0], calls[2]]
