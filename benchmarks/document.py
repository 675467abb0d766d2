"""What every benchmark writes: one JSON document that says which code, versions and machine its numbers are of.

    print(document.text("zpm2-bench-pairs/1", rows=rows))

`check` is the schema. tests/test_benchmarks.py applies it to every JSON file in this folder.
"""

import json
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("zpm2", "torch", "kornia", "openvino", "opencv-python-headless", "numpy", "scipy", "shapely")
WITHOUT_MACHINE = ("zpm2-bench-sigma/1", "zpm2-bench-chance/1")  # written before the machine was part of the schema


def stamped(schema: str, **content: Any) -> dict[str, Any]:
    """`content` with the schema's name and the environment in front; `ValueError` as from `check`."""
    document = {"schema": schema, "environment": environment(), **content}
    check(document)
    return document


def text(schema: str, **content: Any) -> str:
    """`stamped` as JSON."""
    return json.dumps(stamped(schema, **content), indent=1)


def environment() -> dict[str, Any]:
    """Commit ("-dirty" with changes that are not committed), versions and machine."""
    return {
        "commit": _git("describe", "--always", "--dirty", "--exclude=*") or "unknown",
        "python": platform.python_version(),
        "versions": {name: found for name in PACKAGES if (found := _version(name))},
        "machine": {
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count() or 1,
            "device": _device(),
        },
    }


def check(document: Mapping[str, Any]) -> None:
    """`ValueError` for what is no document of a benchmark.

    schema: "zpm2-bench-NAME/VERSION"; environment: commit, python and versions as text, machine with processor, cores
    and device; rows and table, where there are any, hold objects; and there is some content.
    """
    name = document.get("schema")
    _require(isinstance(name, str) and re.fullmatch(r"zpm2-bench-[a-z-]+/[1-9]\d*", name), f"schema is {name!r}")
    found = document.get("environment")
    _require(isinstance(found, Mapping), "environment is missing")
    assert isinstance(found, Mapping)
    commit = found.get("commit")
    _require(
        isinstance(commit, str) and re.fullmatch(r"([0-9a-f]{7,40}(-dirty)?|unknown)", commit), f"commit is {commit!r}"
    )
    versions = found.get("versions")
    _require(isinstance(versions, Mapping) and versions, "versions are missing")
    texts = [found.get("python"), *(versions or {}).values()]
    _require(all(isinstance(each, str) and each for each in texts), "a version is no text")
    if name not in WITHOUT_MACHINE:
        machine = found.get("machine")
        _require(isinstance(machine, Mapping), "machine is missing")
        assert isinstance(machine, Mapping)
        _require(isinstance(machine.get("cores"), int) and machine["cores"] > 0, "cores are no number above 0")
        words = [machine.get("processor"), machine.get("device")]
        _require(all(isinstance(each, str) and each for each in words), "processor or device is missing")
    _require(set(document) - {"schema", "environment"}, "there is no content")
    for key in ("rows", "table"):
        lines = document.get(key, [])
        lines = list(lines.values()) if isinstance(lines, Mapping) else lines
        _require(
            isinstance(lines, list) and all(isinstance(line, Mapping | list) for line in lines), f"{key} are no rows"
        )


def _require(holds: Any, complaint: str) -> None:
    if not holds:
        raise ValueError(f"no document of a benchmark: {complaint}")


def _git(*words: str) -> str:
    folder = Path(__file__).parent
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _device() -> str:
    import torch

    return str(torch.cuda.get_device_name()) if torch.cuda.is_available() else "cpu"
