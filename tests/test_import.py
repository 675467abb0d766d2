"""What is imported when: light things stay light."""

import subprocess
import sys

import pytest

import zpm2

HEAVY = ("torch", "kornia", "openvino", "cv2", "scipy", "shapely", "requests", "huggingface_hub")


def loaded_by(code: str) -> set[str]:
    """Which of the HEAVY modules a fresh Python has after `code`."""
    script = f"import sys\n{code}\nprint('modules:', *(m for m in {HEAVY} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stdout.rpartition("modules:")[2].split())


def test_the_package_imports_nothing_heavy() -> None:
    assert loaded_by("import zpm2; dir(zpm2); zpm2.__version__; zpm2.preset('paper'); zpm2.Zpm2Error") == set()


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["match", "--help"], ["weights", "list"]])
def test_the_command_line_answers_without_the_heavy_parts(arguments: list[str]) -> None:
    code = (
        f"from zpm2.cli import main\nsys.argv = ['zpm2', *{arguments}]\ntry:\n    main()\nexcept SystemExit:\n    pass"
    )
    assert loaded_by(code) == set()


def test_results_are_read_without_torch() -> None:
    assert "torch" not in loaded_by("import zpm2; zpm2.MatchResult; zpm2.Polygon")


def test_public_names() -> None:
    assert dir(zpm2) == sorted(zpm2.__all__)
    for name in zpm2.__all__:
        assert getattr(zpm2, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'mtach'"):
        zpm2.mtach  # noqa: B018


def test_star_import() -> None:
    names: dict[str, object] = {}
    exec("from zpm2 import *", names)
    assert names["match"] is zpm2.match


def test_modules_resolve_without_being_imported() -> None:
    names = "pose", "cloud", "result", "config", "formats"
    code = f"import zpm2\nfor name in {names}: assert getattr(zpm2, name).__name__"
    loaded_by(code)
    assert loaded_by("import zpm2; zpm2.config; zpm2.errors; hasattr(zpm2, 'torch'); hasattr(zpm2, '_no')") == set()


def test_a_module_that_misses_a_dependency_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError("No module named 'elsewhere'", name="elsewhere")

    monkeypatch.setattr(zpm2, "import_module", missing)
    with pytest.raises(ModuleNotFoundError, match="elsewhere"):
        zpm2.some_module  # noqa: B018


def test_python_m_zpm2() -> None:
    done = subprocess.run([sys.executable, "-m", "zpm2", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"{zpm2.__version__}\n"
