"""What zpm2 is installed from: archives, container, conda recipe, and the shell's completion."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = ROOT / "packaging" / "conda" / "recipe.yaml"
# names that conda's packages have
CONDA = {"opencv-python-headless": "py-opencv", "torch": "pytorch", "huggingface-hub": "huggingface_hub"}


def requirement(text: str) -> str:
    """Name and version of a requirement of pip, as conda has it; markers are left out, as the package is for all."""
    name, version = re.fullmatch(r"([\w-]+)(\[.*\])?(>=[\w.]+)(;.*)?", text.replace(" ", "")).group(1, 3)  # type: ignore[union-attr]
    return f"{CONDA.get(name, name)} {version}"


def test_the_conda_recipe_asks_for_what_pyproject_asks_for() -> None:
    recipe = pytest.importorskip("yaml").safe_load(RECIPE.read_text(encoding="utf-8"))
    wanted = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["geo"]]
    assert recipe["requirements"]["run"] == [
        f"python {PROJECT['requires-python']}",
        *(requirement(text) for text in wanted),
    ]
    host = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    assert recipe["requirements"]["host"][2:] == [requirement(text) for text in host]
    scripts = [f"{name} = {target}" for name, target in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts
    assert recipe["about"]["license"] == PROJECT["license"]


def test_the_conda_recipe_renders() -> None:
    rattler = pytest.importorskip("rattler_build", reason="py-rattler-build is not installed")
    rendered = rattler.Stage0Recipe.from_file(str(RECIPE)).render(rattler.VariantConfig())
    assert [each.recipe.to_dict()["package"]["name"] for each in rendered] == ["zpm2"]


def test_the_image_is_made_from_what_is_not_ignored() -> None:
    kept = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    copies = [line.split()[1:-1] for line in (ROOT / "Dockerfile").read_text().splitlines() if line.startswith("COPY ")]
    sources = {word for words in copies for word in words if not any(each.startswith("--") for each in words)}
    assert sources == kept
    assert all((ROOT / name).exists() for name in kept)


def test_each_extra_is_documented() -> None:
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    extras = page.partition("\n## Extras\n")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", extras, re.MULTILINE)) == set(PROJECT["optional-dependencies"])


@pytest.mark.skipif(sys.platform == "win32", reason="no bash")
def test_bash_completes_commands_options_and_values() -> None:
    def complete(line: str) -> list[str]:
        words = shlex.split(line)
        count = len(words) if line.endswith(" ") else len(words) - 1
        asked = {"_ZPM2_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(count)}
        done = subprocess.run(
            [sys.executable, "-m", "zpm2"], env=os.environ | asked, capture_output=True, text=True, check=True
        )
        return done.stdout.split()

    assert complete("zpm2 ca") == ["carry"]
    assert complete("zpm2 match --non") == ["--non-overlapping"]
    assert "balanced" in complete("zpm2 match --quality ")


def test_archives_are_the_same_bytes_wherever_they_are_built(tmp_path: Path) -> None:
    for name in ("build", "hatchling", "hatch_vcs"):
        pytest.importorskip(name, reason=f"{name} is not installed (docs/release.md)")
    if not (ROOT / ".git").exists():
        pytest.skip("no repository to clone")
    made = []
    for name, mask in (("a", 0o022), ("b", 0o077)):
        before = os.umask(mask)
        try:
            subprocess.run(["git", "clone", "-q", str(ROOT), str(tmp_path / name)], check=True)
            build = [sys.executable, "-m", "build", "--no-isolation", str(tmp_path / name)]
            subprocess.run(build, check=True, env=os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}, capture_output=True)
        finally:
            os.umask(before)
        made.append({path.name: path.read_bytes() for path in (tmp_path / name / "dist").iterdir()})
    assert len(made[0]) == 2
    assert made[0] == made[1]
