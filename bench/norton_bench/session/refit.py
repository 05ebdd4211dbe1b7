"""The conclusion of a recording, drawn in a process of its own: it takes seconds, and nobody is to wait for it."""

import multiprocessing
import signal
from multiprocessing.connection import Connection
from pathlib import Path

from norton_bench.errors import ExitCode
from norton_bench.session.progress import Summary

READING = "reading the recording"


class Refit:
    """Under way as soon as it is made. Network and report go beside the recording, as with ``norton-bench fit``."""

    def __init__(self, recording: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, emulated = context.Pipe(duplex=False)
        self._process = context.Process(target=_refit, args=(recording, emulated), name="refit", daemon=True)
        self._process.start()
        emulated.close()
        self._summary: Summary | None = None
        self._doing = READING

    def summary(self) -> Summary | None:
        """What came of it, once it is known. Returns at once."""
        while self._summary is None and self._pipe.poll():
            try:
                came: str | Summary = self._pipe.recv()
            except EOFError:
                came = Summary(ExitCode.EXPERIMENT_FAILED, "the fit ended without a word; run norton-bench fit")
            if isinstance(came, Summary):
                self._summary = came
            else:
                self._doing = came
        return self._summary

    @property
    def doing(self) -> str:
        """What it is at, as last heard by :meth:`summary`."""
        return self._doing

    def close(self) -> None:
        """Give it up where it still runs."""
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _refit(recording: Path, pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the watcher's to interpret
    from norton_bench.session.summary import summary_of, summary_of_failure  # noqa: PLC0415  (its imports take seconds)

    try:
        from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

        pipe.send(summary_of(recording, conclude_recording(recording, tell=pipe.send)[1]))
    except BaseException as error:  # told to whoever waits
        pipe.send(summary_of_failure(error, [recording]))
