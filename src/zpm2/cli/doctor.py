"""`zpm2 doctor`: what this installation is and has."""

import json
import os
import platform
from importlib.metadata import PackageNotFoundError, version

from zpm2 import weights
from zpm2.cli.options import AsJson, WeightsDir, use_weights
from zpm2.runtime import package_version, settle_torch

PACKAGES = (
    *("torch", "kornia", "openvino", "poselib", "opencv-python-headless", "shapely", "numpy", "scipy"),
    *("pycolmap", "trimesh", "embreex", "laspy", "rasterio", "pyogrio", "pyarrow", "h5py"),
)


def doctor(as_json: AsJson = False, weights_dir: WeightsDir = None) -> None:
    """Print versions, devices and weights, for a bug report."""
    use_weights(weights_dir)
    findings = examine()
    if as_json:
        print(json.dumps(findings, indent=1))
        return
    for section, values in findings.items():
        print(section)
        for name, value in values.items():
            print(f"  {name:<24} {value}")


def examine() -> dict[str, dict[str, str]]:
    """Versions, devices, cache and weights."""
    return {"versions": _versions(), "devices": _devices(), "weights": _weights()}


def _versions() -> dict[str, str]:
    found: dict[str, str] = {
        "zpm2": package_version(),
        "python": platform.python_version(),
        "system": platform.platform(),
    }
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _devices() -> dict[str, str]:
    import torch

    from zpm2.cores import usable

    settle_torch()
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    names = ", ".join(torch.cuda.get_device_name(k) for k in range(count))
    return {
        "cpu": f"{os.cpu_count()} cores, of which zpm2 uses {usable()}; {torch.get_num_threads()} threads for torch",
        "cuda": names or "none",
        "segmenter on the CPU": "openvino" if _versions()["openvino"] != "not installed" else "torch (slower)",
    }


def _weights() -> dict[str, str]:
    found: dict[str, str] = {"cache": str(weights.cache_dir())}
    for row in weights.status():
        found[row.entry.name] = str(row.path) if row.path else "not here"
    return found
