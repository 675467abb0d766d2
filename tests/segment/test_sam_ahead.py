"""Prompts that are answered before they are asked."""

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2 import cores
from zpm2.segment.sam_ahead import Ahead
from zpm2.segment.sam_backend import EmbeddedPrompts
from zpm2.segment.sam_vicinity import NearTokens

BATCH = 2


def prompts(numbers: list[int], window: int | None = None) -> EmbeddedPrompts:
    """Prompts that hold a number, and see the tokens of a window."""
    near = None if window is None else NearTokens(np.full((len(numbers), 3), window), np.zeros((len(numbers), 3), "f4"))
    return EmbeddedPrompts(np.array(numbers, np.float32).reshape(-1, 1, 1), near)


class Answers:
    """Answers a prompt with its number and its window, and keeps what it was asked."""

    def __init__(self, wait: Callable[[], object] = lambda: None) -> None:
        self.batches: list[list[int]] = []
        self.wait = wait

    def __call__(self, asked: EmbeddedPrompts) -> list[tuple[int, int | None]]:
        numbers = [int(each[0, 0]) for each in asked.sparse]
        self.batches.append(numbers)
        self.wait()
        windows = [None] * len(asked) if asked.near is None else [int(rows[0]) for rows in asked.near.rows]
        return list(zip(numbers, windows, strict=True))

    @property
    def numbers(self) -> list[int]:
        return sorted(number for batch in self.batches for number in batch)


@pytest.fixture(params=[1, 3])
def threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(cores, "usable", lambda: request.param)
    return int(request.param)


@given(st.lists(st.tuples(st.lists(st.integers(0, 9)), st.lists(st.integers(0, 9))), max_size=4), st.integers(1, 3))
def test_each_prompt_gets_its_own_answer(calls: list[tuple[list[int], list[int]]], threads: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cores, "usable", lambda: threads)
        answers = Answers()
        ahead = Ahead(answers, BATCH)
        for asked, soon in calls:
            assert ahead(prompts(asked), lambda soon=soon: prompts(soon)) == [(number, None) for number in asked]  # type: ignore[misc]
        ahead.end()
    assert not len(ahead)
    assert all(1 <= len(batch) <= BATCH for batch in answers.batches)


def test_what_was_likely_is_not_worked_out_again(threads: int) -> None:
    answers = Answers()
    ahead = Ahead(answers, BATCH)
    ahead(prompts([0, 1, 2]), lambda: prompts([3, 4, 5]))
    assert len(ahead) == (3 if threads > 1 else 0)
    assert [number for number, _ in ahead(prompts([3, 5, 4]))] == [3, 5, 4]
    assert answers.numbers == [0, 1, 2, 3, 4, 5]
    assert not len(ahead)


def test_what_is_asked_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "usable", lambda: 2)
    answers = Answers()
    ahead = Ahead(answers, BATCH)
    ahead(prompts([0, 1, 2]), lambda: prompts([3, 4]))
    ahead.end()
    assert sorted(answers.batches[:2]) == [[0, 1], [2]]


def test_prompts_that_see_other_tokens_are_others(threads: int) -> None:
    ahead = Ahead(Answers(), BATCH)
    ahead(prompts([0], window=7), lambda: prompts([1], window=7))
    assert ahead(prompts([1], window=8)) == [(1, 8)]
    assert ahead(prompts([1], window=7)) == [(1, 7)]


def test_what_is_not_asked_is_not_begun_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "usable", lambda: 2)
    go_on, answers = threading.Event(), Answers()

    def answer(asked: EmbeddedPrompts) -> list[tuple[int, int | None]]:
        if asked.sparse[0, 0, 0] > 0:
            go_on.wait(10)
        return answers(asked)

    def soon() -> EmbeddedPrompts:
        go_on.set()
        return prompts([])

    ahead = Ahead(answer, BATCH)
    ahead(prompts([0]), lambda: prompts([1, 2, 3, 4, 5, 6]))  # of which 1 to 4 keep both cores busy
    assert ahead(prompts([1]), soon) == [(1, None)]
    ahead.end()
    assert ahead.idle
    assert {5, 6}.isdisjoint(answers.numbers)


def test_the_end_waits_for_what_is_at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "usable", lambda: 2)
    done = list[int]()
    answers = Answers(lambda: (time.sleep(0.05), done.append(0)))
    ahead = Ahead(answers, BATCH)
    ahead(prompts([0]), lambda: prompts([1, 2, 3]))
    ahead.end()
    begun = len(answers.batches)
    assert len(done) == begun
    assert ahead.idle
    time.sleep(0.1)
    assert len(answers.batches) == begun  # what had not started does not start


def test_an_error_is_raised_for_those_who_ask(threads: int) -> None:
    def answer(asked: EmbeddedPrompts) -> list[int]:
        return [1 // int(each[0, 0]) for each in asked.sparse]

    ahead = Ahead(answer, 1)
    assert ahead(prompts([1]), lambda: prompts([0, 2])) == [1]
    assert ahead(prompts([2])) == [0]
    with pytest.raises(ZeroDivisionError):
        ahead(prompts([0]))
    assert ahead(prompts([1])) == [1]
