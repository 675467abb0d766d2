"""A point matcher of another package: one file, which registers itself."""

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from zpm2 import estimate
from zpm2.api import Matcher
from zpm2.config import PointsConfig, assign, preset
from zpm2.errors import ConfigError
from zpm2.features import METHODS, create, methods, point_matcher
from zpm2.model import Image

TOY = """
import numpy as np

from zpm2.features import point_matcher
from zpm2.model import PointMatches


class Corners:
    name = "toy"

    def match(self, left, right):
        at = np.array([[1.0, 1.0], [left.width - 1.0, 1.0], [1.0, left.height - 1.0]])
        return PointMatches(at, at, np.ones(3))

    def match_many(self, pairs):
        return [self.match(*pair) for pair in pairs]


@point_matcher("toy")
def toy(config, device, progress):
    return Corners()
"""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A module somewhere else, imported."""
    (tmp_path / "toy_points.py").write_text(TOY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "toy_points", raising=False)
    import_module("toy_points")
    yield
    METHODS.remove("toy")


@pytest.mark.usefixtures("toy")
def test_one_file_adds_a_point_matcher() -> None:
    image = Image(np.zeros((20, 30, 3), np.uint8))
    assert "toy" in METHODS
    assert create(PointsConfig(methods=("toy",))).match(image, image).left.tolist() == [[1, 1], [29, 1], [1, 19]]
    with pytest.raises(ConfigError, match=r"did you mean 'toy'\?\); methods are: .*, toy$"):
        create(PointsConfig(methods=("toys",)))
    config = assign(preset("paper"), ["points.methods=toy", "device=cpu"])
    assert estimate.whole(config, [(100, 100)] * 2, True) > 0

    class Nothing:
        name = "nothing"

        def segment(self, image: Image) -> list[object]:
            return []

    blank = np.zeros((64, 64, 3), np.uint8)
    assert len(Matcher(config, segmenter=Nothing())(blank, blank).points) == 3


def test_a_name_is_taken_once() -> None:
    with pytest.raises(
        ValueError, match="two point methods have the name 'sift': one is built in, the other is of the module "
    ):
        point_matcher("sift")(lambda config, device, progress: None)


def test_every_file_of_the_folder_registers_something() -> None:
    folder = Path(methods.__path__[0])
    files = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    registered = {
        getattr(method.build, "func", method.build).__module__.rpartition(".")[2] for method in METHODS.values()
    }
    assert registered == files
