"""Where a session's events come from: one that runs in a process of its own, or the recording of one."""

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from norton_bench.events import Ended, SessionEvent
from norton_bench.rig.rig import Rig
from norton_bench.session.hosted import Hostable, HostedSession
from norton_bench.session.operator import Order
from norton_bench.session.replay import Refit, Replay
from norton_bench.session.schema import Session


class Source(Protocol):
    """None of this waits, but for :meth:`close`."""

    def events(self) -> Iterable[SessionEvent]:
        """All that are new."""
        ...

    def order(self, order: Order) -> None: ...

    def stop(self, reason: str) -> None:
        """At once. May be called from any thread."""
        ...

    def close(self) -> None:
        """End it; may take seconds."""
        ...


class Running:
    """A session under way, or what else may be performed in its place."""

    def __init__(self, rig: Rig, session: Session | Hostable, out: Path, seed: int | None) -> None:
        self._hosted = HostedSession(rig, session, out=out, seed=seed)

    def events(self) -> Iterable[SessionEvent]:
        return self._hosted.events()

    def order(self, order: Order) -> None:
        self._hosted.order(order)

    def stop(self, reason: str) -> None:
        self._hosted.stop(reason)

    def close(self) -> None:
        self._hosted.close()


class Replayed:
    """A recording, which obeys as a session would as far as it can: it stands still, or goes on."""

    def __init__(self, replay: Replay, recording: Path) -> None:
        self.replay = replay
        self._recording = recording
        self._refit: Refit | None = None

    @property
    def summary(self) -> Ended | None:
        """What follows from the recording, once :meth:`fit` has found it."""
        return None if self._refit is None else self._refit.summary()

    @property
    def fitting(self) -> str:
        """What that fit is at; empty where none was begun."""
        return "" if self._refit is None else self._refit.doing

    def fit(self) -> None:
        """Begin to fit the recording, unless that has begun."""
        self._refit = self._refit or Refit(self._recording)

    def events(self) -> Iterable[SessionEvent]:
        return self.replay.events()

    def order(self, order: Order) -> None:
        if order.kind == "pause":
            self.replay.pause()
        elif order.kind == "resume":
            self.replay.resume()

    def stop(self, reason: str) -> None:
        self.replay.pause()

    def close(self) -> None:
        if self._refit is not None:
            self._refit.close()
            self._refit = None
