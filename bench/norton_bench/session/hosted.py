"""A session in a process of its own, watched from this one: events come over a pipe, orders go back over another.

The session never waits for its watcher. A slow watcher loses parts, which the recording has. A watcher that is gone
ends the session as an operator's stop does: the drives idle, the recording complete.
"""

import atexit
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Condition, Thread
from types import FrameType, TracebackType
from typing import Protocol, Self

from norton_bench.errors import ExitCode, exit_code_of, sentence_of
from norton_bench.events import Ended, PartMeasured, SessionEvent, SessionState, StateChanged, Watcher
from norton_bench.loop.stop_word import StopWord
from norton_bench.rig.rig import Rig
from norton_bench.session.operator import Operator, Order
from norton_bench.session.schema import Session

# A stop idles the drives within a tick and closes the recording.
CLOSE_WITHIN_S = 20.0
END_WITHIN_S = 5.0
# About ten seconds of a session in wall time.
MOST_PARTS = 256


class Mailbox:
    """A queue of events for a watcher that may be slow. The number of parts in it is limited; other events are never
    lost.

    It connects two threads. When too many parts wait, the oldest is dropped, and the next part carries the number.
    """

    def __init__(self, most_parts: int = MOST_PARTS) -> None:
        self._most_parts = most_parts
        self._events: deque[SessionEvent] = deque()
        self._parts = 0
        self._closed = False
        self._changed = Condition()

    def put(self, event: SessionEvent) -> None:
        """Never waits."""
        with self._changed:
            self._events.append(event)
            if isinstance(event, PartMeasured):
                self._parts += 1
                if self._parts > self._most_parts:
                    self._drop_one()
            self._changed.notify()

    def take(self) -> tuple[SessionEvent, ...]:
        """All events in it, in order. Never waits."""
        with self._changed:
            events = tuple(self._events)
            self._events.clear()
            self._parts = 0
            return events

    def wait(self) -> SessionEvent | None:
        """Wait for the next event; None once the box is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._events or self._closed)
            if not self._events:
                return None
            event = self._events.popleft()
            self._parts -= isinstance(event, PartMeasured)
            return event

    def close(self) -> None:
        """Accept no more events."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def _drop_one(self) -> None:
        places = [place for place, event in enumerate(self._events) if isinstance(event, PartMeasured)]
        oldest, following = self._events[places[0]], self._events[places[1]]
        assert isinstance(oldest, PartMeasured)
        assert isinstance(following, PartMeasured)
        self._events[places[1]] = replace(following, dropped=following.dropped + oldest.dropped + 1)
        del self._events[places[0]]
        self._parts -= 1


class Hostable(Protocol):
    """Something other than a session that can be run in the child process; it is sent there as a pickle."""

    def perform(self, rig: Rig, *, out: Path, seed: int | None, on_event: Watcher, operator: Operator) -> object:
        """Run it. The last event must be ``Ended``, however it ends."""
        ...


class HostedSession:
    """``session`` on ``rig``, started in a spawned process by the constructor; files are written to the folder ``out``.

    Neither :meth:`events` nor :meth:`order` nor :meth:`stop` ever waits.
    """

    def __init__(self, rig: Rig, session: Session | Hostable, *, out: Path, seed: int | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self.stop_word = StopWord()
        self._out = out
        self._concluding = False
        self._mailbox = Mailbox()
        events, events_end = context.Pipe(duplex=False)
        orders_end, self._orders = context.Pipe(duplex=False)
        arguments = (rig, session, out, seed, self.stop_word, orders_end, events_end)
        self._process = context.Process(target=_host, args=arguments, name="session")
        self._process.start()
        # From now on the child alone holds them, so that each side notices the end of the other.
        events_end.close()
        orders_end.close()
        self._reader = Thread(target=self._read, args=(events,), name="session events", daemon=True)
        self._reader.start()
        # Before multiprocessing's own handler, which would wait until the session is complete.
        atexit.register(self.close)

    @property
    def pid(self) -> int | None:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.is_alive()

    def events(self) -> Sequence[SessionEvent]:
        """The events since the last call, in order; the very last one is ``Ended``."""
        return self._mailbox.take()

    def order(self, order: Order) -> None:
        """Send an order; ignored once the session is over."""
        with suppress(OSError):
            self._orders.send(order)

    def stop(self, reason: str) -> None:
        """Stop the session at once: the loop stops in its next tick."""
        self.stop_word.say(reason)

    def close(self) -> None:
        """Stop what still runs, and wait for its end; may be called twice. A final fit is abandoned."""
        atexit.unregister(self.close)
        self.stop_word.say("the watcher has left")
        self._orders.close()
        self._process.join(0.0 if self._concluding else CLOSE_WITHIN_S)
        for end in (self._process.terminate, self._process.kill):
            if self._process.is_alive():
                end()
                self._process.join(END_WITHIN_S)
        self._reader.join(END_WITHIN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, pipe: Connection) -> None:
        ended = False
        with pipe, suppress(EOFError, OSError):
            while True:
                event = pipe.recv()
                ended = ended or isinstance(event, Ended)
                if isinstance(event, StateChanged):
                    self._concluding = event.state is SessionState.CONCLUDING
                self._mailbox.put(event)
        if not ended:
            self._report_its_death()

    def _report_its_death(self) -> None:
        self._process.join(END_WITHIN_S)
        message = (
            f"the process of the session ended unexpectedly (exit code {self._process.exitcode}); the data are in "
            f"{self._out}: norton-bench recover repairs a recording that was cut off"
        )
        self._mailbox.put(StateChanged(SessionState.FAILED))
        self._mailbox.put(Ended(ExitCode.EXPERIMENT_FAILED, message))


class _Remote:
    """The operator at the other end of a pipe."""

    answers = True

    def __init__(self, stop: StopWord, orders: Connection) -> None:
        self.stop = stop
        self._orders = orders

    def orders(self) -> Sequence[Order]:
        came = []
        try:
            while self._orders.poll():
                came.append(self._orders.recv())
        except (EOFError, OSError):
            self.stop.say("the watcher is gone")
        return came


def _host(
    rig: Rig,
    session: Session | Hostable,
    out: Path,
    seed: int | None,
    stop: StopWord,
    orders: Connection,
    events: Connection,
) -> None:
    """The child: runs the session and sends its events; its exit code is that of the command line."""
    _leave_the_terminal(stop)
    mailbox = Mailbox()
    sender = Thread(target=_send, args=(mailbox, events, stop), name="session events", daemon=True)
    sender.start()
    begun = False
    try:
        from norton_bench.session.engine import run_session  # noqa: PLC0415  (its imports take seconds)

        mailbox.put(StateChanged(SessionState.PREPARING))
        begun = True
        operator = _Remote(stop, orders)
        if isinstance(session, Session):
            run_session(rig, session, out=out, seed=seed, on_event=mailbox.put, operator=operator)
        else:
            session.perform(rig, out=out, seed=seed, on_event=mailbox.put, operator=operator)
        code = ExitCode.OK
    except BaseException as error:  # run_session has sent it; what comes before is sent here
        code = exit_code_of(error)
        if not begun:
            mailbox.put(Ended(code, sentence_of(error)))
    finally:
        mailbox.close()
        sender.join(END_WITHIN_S)
    raise SystemExit(int(code))


def _send(mailbox: Mailbox, pipe: Connection, stop: StopWord) -> None:
    try:
        while (event := mailbox.wait()) is not None:
            pipe.send(event)
    except OSError:
        stop.say("the watcher is gone")


def _leave_the_terminal(stop: StopWord) -> None:
    """Ctrl-C and the terminal belong to the watcher."""

    def end(_number: int, _frame: FrameType | None) -> None:
        if stop.heard() is not None:
            raise KeyboardInterrupt
        stop.say("asked to end")

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
