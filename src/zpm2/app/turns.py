"""The networks serve one request at a time, and of the prompts for one region that wait only the newest."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from zpm2.errors import Zpm2Error

T = TypeVar("T")


class Replaced(Zpm2Error):
    """A prompt had not begun when a newer one came."""

    def __init__(self) -> None:
        super().__init__("a newer prompt took the place of this one")


class Turns:
    """One thread for all that takes long. Its methods are called from one event loop."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="zpm2-app")
        self._turn = asyncio.Lock()
        self._newest: dict[str, object] = {}  # of the prompts of each region that wait or run

    async def one(self, work: Callable[[], T]) -> T:
        """What `work` gives, when all before it is done."""
        async with self._turn:
            return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    async def newest(self, region: str, work: Callable[[], T]) -> T:
        """The same; `Replaced` where another prompt for the region comes before this one has begun."""
        ticket = self._newest[region] = object()

        def unless_replaced() -> T:
            if self._newest.get(region) is not ticket:
                raise Replaced
            return work()

        try:
            return await self.one(unless_replaced)
        finally:
            if self._newest.get(region) is ticket:
                del self._newest[region]

    def close(self) -> None:
        """Begins nothing more."""
        self._thread.shutdown(wait=False, cancel_futures=True)
