"""What a run keeps of finished pairs."""

import numpy as np
import pytest

from zpm2.files.writing import claim
from zpm2.model import PointMatches, Polygon
from zpm2.tracking.matches import KEPT, CarriedRegions, PairMatches, Store

RING = np.array([[0, 0], [10.1, 0], [10.3, 9.7], [0, 10.0]])


def made() -> PairMatches:
    polygon = Polygon(3, RING, (RING[::-1] / 3,))
    points = PointMatches(RING, RING + 1, np.ones(4))
    return PairMatches([polygon], [polygon], np.array([0.7]), points, np.eye(3), ["a warning"], [])


def never() -> PairMatches:
    raise AssertionError("made again")


def test_finished_work_is_used_again(tmp_path):
    folder = claim(tmp_path / "out", []) / KEPT
    first = Store(folder).get("key", PairMatches, made)
    store = Store(folder)
    again = store.get("key", PairMatches, never)
    assert store.reused == 1
    assert np.array_equal(again.left[0].holes[0], first.left[0].holes[0])
    assert np.array_equal(again.points.right, first.points.right)
    assert again.homography.shape == (3, 3)
    assert again.warnings == ["a warning"]


def test_a_pair_without_homography_or_matches_is_kept_too(tmp_path):
    nothing = PairMatches([], [], np.zeros(0), PointMatches.empty(), None, [], [])
    Store(tmp_path).get("key", PairMatches, lambda: nothing)
    again = Store(tmp_path).get("key", PairMatches, never)
    assert again.homography is None
    assert len(again.left) == len(again.confidence) == len(again.points) == 0
    gone = CarriedRegions(["hidden"], np.array([0.0]), [])
    Store(tmp_path).get("carried", CarriedRegions, lambda: gone)
    assert Store(tmp_path).get("carried", CarriedRegions, never).status == ["hidden"]


@pytest.mark.parametrize("content", [b"", b"no gzip", None])
def test_damaged_work_is_done_again(tmp_path, content):
    folder = claim(tmp_path / "out", []) / KEPT
    Store(folder).get("key", PairMatches, made)
    file = folder / "key.json.gz"
    file.write_bytes(file.read_bytes()[:60] if content is None else content)
    store = Store(folder)
    assert len(store.get("key", PairMatches, made).left) == 1
    assert store.reused == 0
    assert len(Store(folder).get("key", PairMatches, never).left) == 1


def test_what_is_no_longer_used_goes(tmp_path):
    folder = claim(tmp_path / "out", []) / KEPT
    for key in ("old", "new"):
        Store(folder).get(key, PairMatches, made)
    store = Store(folder)
    store.get("new", PairMatches, never)
    store.forget_others()
    assert [file.name for file in folder.iterdir()] == ["new.json.gz"]


def test_files_of_others_stay(tmp_path):
    (tmp_path / "mine.json.gz").write_bytes(b"mine")
    Store(tmp_path).get("old", PairMatches, made)
    store = Store(tmp_path)
    store.get("new", PairMatches, made)
    store.forget_others()
    assert sorted(file.name for file in tmp_path.glob("*.gz")) == ["mine.json.gz", "new.json.gz"]


def test_a_temporary_folder_goes(tmp_path):
    folder = claim(tmp_path / "out", []) / KEPT
    with Store(folder).temporary() as place:
        assert place.is_relative_to(tmp_path / "out/.zpm2")
        (place / "0.npz").write_bytes(b"")
    assert not list((tmp_path / "out").rglob("*.npz"))
    with Store(None).temporary() as place:
        assert place is None


def test_without_a_folder_nothing_is_kept():
    store = Store(None)
    assert len(store.get("key", PairMatches, made).left) == 1
    store.forget_others()
