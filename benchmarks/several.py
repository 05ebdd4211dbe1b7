"""Many sessions of a benchmark: by the seeds of its command line, in processes of their own."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

Found = TypeVar("Found")
Task = TypeVar("Task")


def seeds_in(written: str) -> range:
    """The seeds of "first-last", or of one number."""
    first, _, last = written.partition("-")
    return range(int(first), int(last or first) + 1)


def one_thread_each() -> None:
    """Processes to come compute with one thread each: as many of them as cores run already."""
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")


def carried_out_by(
    work: Callable[[Task], Found | None], tasks: Iterable[Task], jobs: int, told: Callable[[Found], str]
) -> Iterator[Found]:
    """What ``work`` finds for each task, such as a seed, in turn, in processes of their own; ``told`` makes a line of
    progress."""
    one_thread_each()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for outcome in pool.map(work, tasks):
            if outcome is not None:
                print(told(outcome), file=sys.stderr, flush=True)
                yield outcome
