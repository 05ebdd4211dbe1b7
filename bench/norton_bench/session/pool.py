"""A pool of processes, to run many sessions in parallel."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import FrameType

# A session that gets a signal closes its recording and its folder in less than this. The signal may be lost: while
# compiled code asks whether an object is a sequence, it takes any exception for "no".
END_WITHIN_S = 2.0
TELL_TIMES = 5

Handler = Callable[[int, FrameType | None], object] | int


@contextmanager
def process_pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of ``jobs`` new processes. After a failure, Ctrl-C or SIGTERM, everything in them is ended at once.

    SIGTERM is raised as a KeyboardInterrupt, as Ctrl-C is.
    """
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with (
        _on_signals({signal.SIGTERM: _interrupt}),
        ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_when_told) as pool,
    ):
        try:
            yield pool
        except BaseException:
            # A second Ctrl-C must not interrupt this: the pool would print errors about the processes that are left.
            with _on_signals({signal.SIGINT: signal.SIG_IGN, signal.SIGTERM: signal.SIG_IGN}):
                pool.shutdown(wait=False, cancel_futures=True)
                _end([child for child in multiprocessing.active_children() if child not in others])
                pool.shutdown()
            raise


def _end(processes: list[BaseProcess]) -> None:
    for _ in range(TELL_TIMES):
        for process in processes:
            process.terminate()
        for process in processes:
            process.join(END_WITHIN_S)
        if not any(process.is_alive() for process in processes):
            return
    for process in processes:
        process.kill()


@contextmanager
def _on_signals(handlers: dict[signal.Signals, Handler]) -> Iterator[None]:
    """Inside, signals go to ``handlers``; only in the main thread, for no other thread may set handlers."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _end_when_told() -> None:
    """In each process: ignore Ctrl-C, which the parent handles; on SIGTERM let the session close its files."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)


def _leave(_number: int, _frame: FrameType | None) -> None:
    # The pool sends even this exception to its parent, and prints an error where the pipe is closed by then.
    sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  (until it ends)
    raise SystemExit
