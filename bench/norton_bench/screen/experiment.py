"""One experiment as the screens see it: the source of its events, its state, and the orders it takes."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from norton_bench.events import Ended, Planned, PlannedStep, Prompt, SessionEvent, SessionState
from norton_bench.jog.by_hand import Jog
from norton_bench.jog.hands import NAME
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.screen.panels.progress import BADGES, HALTED, REPLAYING, Badge
from norton_bench.screen.picture.picture import OVER, Picture
from norton_bench.session.hosted import Hostable, HostedSession
from norton_bench.session.operator import Kind, Order
from norton_bench.session.replay import Refit, Replay, load_replay
from norton_bench.session.schema import Session, load_session, standard_session


class EventSource(Protocol):
    """A source of events. No method waits, except :meth:`close`."""

    def events(self) -> Iterable[SessionEvent]:
        """All new events."""
        ...

    def order(self, order: Order) -> None: ...

    def stop(self, reason: str) -> None:
        """Stop at once. May be called from any thread."""
        ...

    def close(self) -> None:
        """End it; may take seconds."""
        ...


class Running:
    """A running session, or another experiment in its place."""

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
    """A recording that is played back; of the orders it obeys pause and resume."""

    def __init__(self, replay: Replay, recording: Path) -> None:
        self.replay = replay
        self._recording = recording
        self._refit: Refit | None = None

    @property
    def summary(self) -> Ended | None:
        """The result of :meth:`fit`, None before it is known."""
        return None if self._refit is None else self._refit.summary()

    @property
    def fitting(self) -> str:
        """The stage of the fit; empty where none was started."""
        return "" if self._refit is None else self._refit.doing

    def fit(self) -> None:
        """Start the fit of the recording, unless it was started."""
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


# A session sends no event for these; a replay obeys them at once.
BY_KEY = "the operator, by key"


class Experiment:
    """Ready until :meth:`start`; over after the event ``Ended``.

    ``begin`` makes the source of its events each time it is started; ``plan`` is shown until then. ``by_hand`` is
    given where the bench is moved by hand, without a session.
    """

    def __init__(
        self,
        rig: Rig,
        what: str,
        begin: Callable[[], EventSource],
        *,
        plan: Sequence[PlannedStep] = (),
        by_hand: Jog | None = None,
    ) -> None:
        self.rig, self.what, self.by_hand = rig, what, by_hand
        self.picture = Picture(rig)
        self.picture.take(Planned(tuple(plan)))
        self.stopped = False
        self._begin = begin
        self.source: EventSource | None = None

    @property
    def replay(self) -> Replayed | None:
        """The replay; None for a running session."""
        return self.source if isinstance(self.source, Replayed) else None

    @property
    def over(self) -> bool:
        return self.picture.state in OVER

    @property
    def live(self) -> bool:
        """Whether a session runs, including its final fit."""
        return self.source is not None and self.replay is None and not self.over

    @property
    def moving(self) -> bool:
        """Whether drives may still move: until the final fit begins."""
        return self.live and not self.picture.concluding

    @property
    def stoppable(self) -> bool:
        """Whether a stop would have an effect."""
        return self.moving or (self.replay is not None and not self.replay.replay.paused and not self.over)

    @property
    def paused(self) -> bool:
        if self.replay is not None:
            return self.replay.replay.paused
        return self.picture.state in (SessionState.PAUSED, SessionState.PAUSING)

    @property
    def prompt(self) -> Prompt | None:
        return self.picture.prompt if self.live else None

    @property
    def summary(self) -> Ended | None:
        """The event ``Ended``; of a replay, the result of the fit."""
        return self.picture.summary if self.replay is None else self.replay.summary

    @property
    def fitting(self) -> str:
        """The stage of a running fit; empty where none runs."""
        if self.replay is not None:
            return self.replay.fitting
        picture = self.picture
        return f"{picture.fitting}, {picture.fit_took_s} s so far" if picture.concluding else ""

    def start(self) -> None:
        """Start it, also again after its end."""
        self.picture, self.stopped = Picture(self.rig), False
        self.source = self._begin()

    def update(self) -> None:
        """Take the new events."""
        if self.source is not None:
            for event in self.source.events():
                self.picture.take(event)
            self.picture.look_at_clock()

    def order(self, kind: Kind, text: str = "") -> None:
        if self.source is not None:
            self.source.order(Order(kind, text))

    def stop(self, reason: str = BY_KEY) -> None:
        """Stop at once; from any thread. The first reason counts."""
        if self.source is not None and self.stoppable:
            self.stopped = True
            self.source.stop(reason)

    def seek(self, to_s: float) -> None:
        """Replay from ``to_s`` on; the state is built anew up to there."""
        if self.replay is not None:
            self.picture = Picture(self.rig)
            self.replay.replay.seek(to_s)

    def close(self) -> None:
        """End the session, and wait for its end."""
        if self.source is not None:
            self.source.close()


def badge_of(experiment: Experiment) -> Badge:
    """Where it is, in a sign and a word."""
    if experiment.replay is None:
        return BADGES[experiment.picture.state]
    replay = experiment.replay.replay
    return HALTED if replay.paused or replay.ended else REPLAYING


@dataclass(frozen=True)
class Opening:
    """The choices of the command line, and the experiments made from them. What is not given is chosen on the screen.

    ``make_out`` makes the folder for the results, below ``runs``, from the name of the rig.
    """

    make_out: Callable[[str], Path]
    rig_path: Path | None = None
    session_path: Path | None = None
    recording: Path | None = None
    backend: str | None = None
    seed: int | None = None
    folder: Path = field(default_factory=Path)
    runs: Path = field(default_factory=lambda: Path("runs"))
    jog: Jog = field(default_factory=Jog)

    def given(self) -> Experiment | None:
        """The experiment; None where rig or session must be chosen. Raises BenchError for files that cannot be used."""
        if self.recording is not None:
            return replayed(self.recording)
        if self.session_path is None:
            if self.rig_path is not None:
                self.load_rig(self.rig_path)
            return None
        session = load_session(self.session_path)
        rig_path = self.rig_path or session.rig
        return None if rig_path is None else self._experiment(self.load_rig(rig_path), session)

    def load_rig(self, path: Path) -> Rig:
        """The rig in the file, on the backend of the command line."""
        return load_rig(path, backend=self.backend)

    def experiment(self, rig: Rig, session_path: Path | None) -> Experiment:
        """The session in the file on ``rig``, or the standard one."""
        return self._experiment(rig, standard_session(rig) if session_path is None else load_session(session_path))

    def by_hand(self, rig: Rig) -> Experiment:
        """The rig moved by hand, with the options of ``jog``."""
        return Experiment(
            rig, NAME, lambda: Running(rig, self.jog, self.make_out(rig.name), self.seed), by_hand=self.jog
        )

    def _experiment(self, rig: Rig, session: Session) -> Experiment:
        """Raises BenchError for a session that this rig cannot perform. Takes a second the first time."""
        from norton_bench.check.check import refuse_impossible  # noqa: PLC0415  (brings the devices along)
        from norton_bench.session.program import make_experiment  # noqa: PLC0415  (brings the report along)

        seed = session.seed if self.seed is None else self.seed
        refuse_impossible(rig, seed)

        def begin() -> EventSource:
            return Running(rig, session, self.make_out(rig.name), seed)

        return Experiment(rig, session.place, begin, plan=make_experiment(session, rig).plan)


def replayed(recording: Path) -> Experiment:
    """The recording as an experiment that runs already. Raises UsageError for a file that cannot be replayed."""
    replay, read = load_replay(recording)
    rig = parse_rig(read.rig_text, place=str(recording))
    experiment = Experiment(rig, recording.name, lambda: Replayed(replay, recording))
    experiment.start()
    return experiment
