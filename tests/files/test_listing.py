"""Folders of photographs, and names for photographs of several folders."""

from pathlib import Path

import pytest

from zpm2.errors import InputError
from zpm2.files.listing import distinct_names
from zpm2.photos.listing import some_photographs


def touch(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_photographs_in_sub_folders_are_said(tmp_path: Path) -> None:
    folder = tmp_path / ".hidden" / "photos"
    touch(folder / "a" / "1.jpg", folder / ".thumbnails" / "1.jpg", folder / "notes.txt")
    with pytest.raises(InputError, match=r"photos holds no photographs itself, .*photos/a do: give one of these"):
        some_photographs(folder)
    touch(folder / "b" / "deep" / "1.JPG", folder / "c" / "1.jpg")
    with pytest.raises(InputError, match=r"photos/a and 2 more sub-folders do"):
        some_photographs(folder)
    touch(folder / "2.png")
    assert some_photographs(folder) == [folder / "2.png"]


def test_a_folder_without_photographs(tmp_path: Path) -> None:
    touch(tmp_path / "notes.txt")
    with pytest.raises(InputError, match=r"holds no photographs \(\.png, "):
        some_photographs(tmp_path)
    with pytest.raises(InputError, match="not there"):
        some_photographs(tmp_path / "nowhere")


def test_names_stay_short_where_they_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert distinct_names([tmp_path / "a" / "1.png", tmp_path / "b" / "2.png"]) == ["1.png", "2.png"]
    assert distinct_names([tmp_path / "a" / "1.png", tmp_path / "b" / "1.png"]) == ["a/1.png", "b/1.png"]
    assert distinct_names([tmp_path / "1.png", tmp_path / "b" / "1.png"]) == ["1.png", "b/1.png"]
    monkeypatch.chdir(tmp_path)
    assert distinct_names([Path("a/1.png"), Path("a/../b/1.png")]) == ["a/1.png", "b/1.png"]
    assert len(set(distinct_names([Path("a/1.png"), tmp_path / "a" / "1.png"]))) == 1
