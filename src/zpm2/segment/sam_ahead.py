"""Prompts that are answered before they are asked.

Which prompts are next depends on what those before them find. Until that is known, and while one core waits for the
others at the end of a call, cores are idle. Nearly all prompts that are likely to be next are asked in the end, and
what a prompt is answered depends neither on when it is nor on what is asked with it.
"""

from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from zpm2.cores import begin
from zpm2.segment.sam_backend import EmbeddedPrompts

Answer = TypeVar("Answer")


class Ahead(Generic[Answer]):
    """The answers to prompts of one form in one view, on all cores.

    `answer` gives those to at most `batch` prompts, on one core.
    """

    def __init__(self, answer: Callable[[EmbeddedPrompts], list[Answer]], batch: int) -> None:
        self._answer, self._batch = answer, batch
        self._begun: dict[bytes, tuple[Future[list[Answer]], int]] = {}  # of a prompt: its batch, and its row there
        self._at_work: list[Future[list[Answer]]] = []  # batches that have not ended, also of dropped prompts

    def __len__(self) -> int:
        """How many prompts were begun and not asked yet."""
        return len(self._begun)

    @property
    def idle(self) -> bool:
        """Whether no prompt is begun and no core is at work."""
        return not self._begun and all(batch.done() for batch in self._at_work)

    def __call__(self, asked: EmbeddedPrompts, soon: Callable[[], EmbeddedPrompts] | None = None) -> list[Answer]:
        """The answer to each prompt that is asked. Cores that are idle meanwhile, and after that, go on with those that
        may be asked `soon`. What was begun so and is not asked now is dropped."""
        names = _names(asked)
        self._at_work = [batch for batch in self._at_work if not batch.done()]
        self._drop(self._begun.keys() - set(names))
        try:
            if self._begin(asked, names, needed=True) and soon is not None:
                later = soon()
                self._begin(later, _names(later), needed=False)
            return [batch.result()[row] for batch, row in (self._begun[name] for name in names)]
        finally:
            self._drop(names)

    def end(self) -> None:
        """Drops what was begun, and waits until no core is at work."""
        self._drop(list(self._begun))
        wait(self._at_work)

    def _begin(self, prompts: EmbeddedPrompts, names: list[bytes], needed: bool) -> bool:
        """Hands out the prompts that are not begun yet, and says whether there are several cores. Where there is one,
        it answers those that are `needed`."""
        new = np.array([row for row, name in enumerate(names) if name not in self._begun], np.intp)
        several = True
        for start in range(0, len(new), self._batch):
            rows = new[start : start + self._batch]
            answers = partial(self._answer, prompts[rows])
            batch = begin(answers)
            if batch is None:
                several = False
                if not needed:
                    break
                batch = Future()
                batch.set_result(answers())
            self._at_work.append(batch)
            self._begun |= {names[row]: (batch, k) for k, row in enumerate(rows)}
        return several

    def _drop(self, names: Iterable[bytes]) -> None:
        """Forgets prompts. A batch of which none is left is not started any more."""
        gone = [self._begun.pop(name)[0] for name in names if name in self._begun]
        left = {id(batch) for batch, _ in self._begun.values()}
        for batch in gone:
            if id(batch) not in left:
                batch.cancel()


def _names(prompts: EmbeddedPrompts) -> list[bytes]:
    """Of each prompt all that its answer depends on, in one view."""
    sparse, near = prompts.sparse, prompts.near
    if near is None:
        return [each.tobytes() for each in sparse]
    return [b"".join(part.tobytes() for part in each) for each in zip(sparse, near.rows, near.log_count, strict=True)]
