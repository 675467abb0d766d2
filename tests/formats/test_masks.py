"""Masks for other programs: names, which side is black, and the frames of Nerfstudio."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import shapely

from zpm2.errors import ConfigError, InputError
from zpm2.formats.masks import NAMES, RegionMask, write_masks
from zpm2.model import Georeference
from zpm2.polygons.rasterize import rasterize_stack

SIZE = 40, 30


@dataclass(frozen=True)
class Photo:
    path: str | None
    width: int = SIZE[0]
    height: int = SIZE[1]
    geo: Georeference = field(default_factory=Georeference)


SHAPES = [
    shapely.box(2, 3, 12, 9),
    shapely.Polygon(shapely.box(15.5, 5, 30, 20).exterior, [shapely.box(18, 8, 22, 12).exterior.coords]),
    shapely.MultiPolygon([shapely.box(-5, 25, 4, 40), shapely.box(35, 1, 60, 4)]),  # beyond the border
]
INSIDE = rasterize_stack(np.array(SHAPES, object), SIZE).any(0)


def read(path: Path) -> np.ndarray:
    with PIL.Image.open(path) as picture:
        assert picture.mode == "L"
        return np.asarray(picture)


@pytest.mark.parametrize("keep", [True, False])
def test_each_program_finds_its_masks_under_its_names(tmp_path: Path, keep: bool) -> None:
    photos = [Photo("/photos/IMG_1.JPG"), Photo("IMG.2.tif")]
    told = write_masks(tmp_path / "masks", list(NAMES), [RegionMask(photo, SHAPES) for photo in photos], keep)
    assert len(told) == 1
    assert "transforms.json" in told[0]
    found = sorted(path.relative_to(tmp_path / "masks").as_posix() for path in (tmp_path / "masks").rglob("*.*"))
    assert found == [
        *("colmap/IMG.2.tif.png", "colmap/IMG_1.JPG.png"),
        *("nerfstudio/masks/IMG.2.png", "nerfstudio/masks/IMG_1.png", "nerfstudio/transforms.json"),
        *("openmvs/IMG.2.mask.png", "openmvs/IMG_1.mask.png"),
    ]
    for path in (tmp_path / "masks").rglob("*.png"):
        bits = read(path)
        assert set(np.unique(bits)) == {0, 255}
        assert ((bits == 255) == (keep == INSIDE)).all()


def test_labels_and_outlines_give_the_same_mask(tmp_path: Path) -> None:
    labels = np.where(INSIDE, 7, 0)
    for k, regions in enumerate((labels, SHAPES)):
        write_masks(tmp_path / str(k), ["openmvs"], [RegionMask(Photo("a.png"), regions)], True)
    one, two = (tmp_path / str(k) / "openmvs" / "a.mask.png" for k in range(2))
    assert one.read_bytes() == two.read_bytes()
    with pytest.raises(InputError, match="must be of its size"):
        RegionMask(Photo("a.png"), labels.T).bits()


def test_no_regions_at_all(tmp_path: Path) -> None:
    write_masks(tmp_path / "m", ["colmap"], [RegionMask(Photo("a.png"), [])], False)
    assert (read(tmp_path / "m" / "colmap" / "a.png.png") == 255).all()


def test_the_frames_of_a_data_set_get_their_masks(tmp_path: Path) -> None:
    """`mask_path` is relative to the folder of `transforms.json`, as `file_path` is."""
    (tmp_path / "set" / "images").mkdir(parents=True)
    frames = [{"file_path": f"images/{name}.jpg", "transform_matrix": [[1, 0, 0, 0]]} for name in "abc"]
    (tmp_path / "set" / "transforms.json").write_text(json.dumps({"fl_x": 1072.25, "frames": frames}))
    masks = [RegionMask(Photo(str(tmp_path / "set" / "images" / f"{name}.jpg")), SHAPES) for name in "ab"]
    told = write_masks(tmp_path / "m", ["nerfstudio"], masks, True)
    assert "without a mask" in told[0]
    assert told[0].endswith(": 1; Nerfstudio wants one for each frame or for none")
    written = json.loads((tmp_path / "m" / "nerfstudio" / "transforms.json").read_text())
    assert written["fl_x"] == 1072.25
    assert [frame.get("mask_path") for frame in written["frames"]] == ["masks/a.png", "masks/b.png", None]
    assert written["frames"][0]["transform_matrix"] == [[1, 0, 0, 0]]
    assert (tmp_path / "m" / "nerfstudio" / written["frames"][0]["mask_path"]).exists()
    masks.append(RegionMask(Photo(str(tmp_path / "set" / "images" / "c.jpg")), []))
    assert write_masks(tmp_path / "m2", ["nerfstudio"], masks, True) == []
    (tmp_path / "set" / "transforms.json").write_text("{")  # damaged: as if there were none
    assert "no cameras" in write_masks(tmp_path / "m3", ["nerfstudio"], masks, True)[0]


def test_misuse(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'colmap'"):
        write_masks(tmp_path, ["colmp"], [], True)
    same = [RegionMask(Photo("a/1.png"), []), RegionMask(Photo("b/1.jpg"), [])]
    write_masks(tmp_path / "m", ["colmap"], same, True)  # 1.png.png and 1.jpg.png
    with pytest.raises(ConfigError, match=r"several masks named 1\.mask\.png"):
        write_masks(tmp_path / "m", ["openmvs"], same, True)
