import pytest

from zpm2.model.messages import Note, about, split


def test_a_message_is_a_warning_unless_it_is_a_note() -> None:
    assert split(["a", Note("b"), "c", "a", Note("b")]) == (["a", "c"], ["b"])
    assert all(type(text) is str for kind in split(["a", Note("b")]) for text in kind)


def test_a_note_with_its_subject_is_still_a_note() -> None:
    assert split(about("left image", ["a", Note("b")])) == (["left image: a"], ["left image: b"])


@pytest.mark.parametrize("messages", [[], ["a"], [Note("a")]])
def test_split_gives_two_lists(messages: list[str]) -> None:
    assert [len(kind) for kind in split(messages)] == [
        sum(not isinstance(m, Note) for m in messages),
        sum(isinstance(m, Note) for m in messages),
    ]
