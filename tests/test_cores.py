"""Rows on several cores."""

import os
import subprocess
import sys
import threading

import cv2
import pytest

from zpm2 import cores
from zpm2.cores import begin, in_chunks

SPIN = "OPENCV_THREAD_POOL_ACTIVE_WAIT_WORKER"
OWN = {"OMP_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "3", SPIN: "7"}  # a user's own


def rows_of(part: slice) -> list[int]:
    return list(range(part.start, part.stop))


@pytest.mark.parametrize("threads", ["1", "3"])
@pytest.mark.parametrize("count", [0, 1, 4, 5, 23])
def test_chunks_cover_all_rows_in_order(monkeypatch, threads, count):
    monkeypatch.setattr(cores, "usable", lambda: int(threads))
    assert [row for part in in_chunks(rows_of, count, 4) for row in part] == list(range(count))


def test_chunks_do_not_depend_on_the_number_of_cores(monkeypatch):
    found = []
    for threads in (1, 4):
        monkeypatch.setattr(cores, "usable", lambda threads=threads: threads)
        found.append(in_chunks(lambda part: (part.start, part.stop), 10, 3))
    assert found[0] == found[1] == [(0, 3), (3, 6), (6, 9), (9, 10)]


def test_several_cores_work_at_the_same_time(monkeypatch):
    monkeypatch.setattr(cores, "usable", lambda: 2)
    both = threading.Barrier(2, timeout=10)
    in_chunks(lambda part: both.wait(), 2, 1)  # BrokenBarrierError if one waits for the other to end


def test_chunks_within_chunks_stay_in_their_thread(monkeypatch):
    monkeypatch.setattr(cores, "usable", lambda: 2)

    def names(part: slice) -> set[str]:
        return {threading.current_thread().name, *in_chunks(lambda _: threading.current_thread().name, 8, 1)}

    assert [len(found) for found in in_chunks(names, 8, 1)] == [1] * 8


def test_what_is_begun_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(cores, "usable", lambda: 2)
    go_on = threading.Event()
    begun = begin(lambda: go_on.wait(10))
    assert begun is not None
    assert not begun.done()
    go_on.set()
    assert begun.result(10)


def test_nothing_is_begun_where_one_core_does_all(monkeypatch):
    monkeypatch.setattr(cores, "usable", lambda: 2)
    assert in_chunks(lambda part: begin(pytest.fail), 2, 1) == [None, None]
    monkeypatch.setattr(cores, "usable", lambda: 1)
    assert begin(pytest.fail) is None


def test_an_error_is_raised(monkeypatch):
    monkeypatch.setattr(cores, "usable", lambda: 2)
    with pytest.raises(ZeroDivisionError):
        in_chunks(lambda part: 1 // part.start, 4, 1)


@pytest.mark.parametrize(("given", "expected"), [("1", 1), ("", None), ("no number", None), ("100000", None)])
def test_usable_cores_are_limited_as_those_of_other_libraries(monkeypatch, given, expected):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    most = cores.usable()
    monkeypatch.setenv("OMP_NUM_THREADS", given)
    assert cores.usable() == (expected or most)
    assert cores.limit() == (cores.usable() if cores.usable() < os.cpu_count() else None)


@pytest.mark.parametrize(("given", "expected"), [({"OMP_NUM_THREADS": "1"}, "1 0"), ({}, "all own"), (OWN, "3 7")])
def test_opencv_takes_as_many_threads_and_does_not_spin_where_cores_are_shared(given, expected):
    """In a process of its own, as OpenCV looks at the environment when it is loaded."""
    script = f"import zpm2, cv2, os; print(cv2.getNumThreads(), os.environ.get({SPIN!r}, 'own'))"
    plain = {name: value for name, value in os.environ.items() if name not in OWN}
    done = subprocess.run([sys.executable, "-c", script], env=plain | given, capture_output=True, text=True, check=True)
    assert done.stdout.split() == expected.replace("all", str(cv2.getNumberOfCPUs())).split()
