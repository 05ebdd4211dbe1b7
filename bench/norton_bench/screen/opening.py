"""What was asked for on the command line, and experiments made of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from norton_bench.jog.by_hand import Jog
from norton_bench.jog.course import NAME
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.screen.experiment import Experiment
from norton_bench.screen.sources import Replayed, Running, Source
from norton_bench.session.replay import load_replay
from norton_bench.session.schema import Session, load_session, standard_session


@dataclass(frozen=True)
class Opening:
    """``make_out`` makes the folder for the results of a session on a rig, by the rig's name; it lies in ``runs``.

    What is not given is chosen at the screen.
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
        """The experiment, where nothing is left to choose. Raises BenchError for files that cannot be used."""
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
        """On the backend asked for."""
        return load_rig(path, backend=self.backend)

    def experiment(self, rig: Rig, session_path: Path | None) -> Experiment:
        """The session in the file on ``rig``, or the standard one."""
        return self._experiment(rig, standard_session(rig) if session_path is None else load_session(session_path))

    def by_hand(self, rig: Rig) -> Experiment:
        """The rig moved by hand, as ``jog`` says."""
        return Experiment(
            rig, NAME, lambda: Running(rig, self.jog, self.make_out(rig.name), self.seed), by_hand=self.jog
        )

    def _experiment(self, rig: Rig, session: Session) -> Experiment:
        """Raises BenchError for a session that this rig cannot perform. Takes a second the first time."""
        from norton_bench.session.program import make_experiment  # noqa: PLC0415  (brings the report along)

        seed = session.seed if self.seed is None else self.seed

        def begin() -> Source:
            return Running(rig, session, self.make_out(rig.name), seed)

        return Experiment(rig, session.place, begin, plan=make_experiment(session, rig).plan)


def replayed(recording: Path) -> Experiment:
    """The recording as an experiment that runs already. Raises UsageError."""
    replay, read = load_replay(recording)
    rig = parse_rig(read.rig_text, place=str(recording))
    experiment = Experiment(rig, recording.name, lambda: Replayed(replay, recording))
    experiment.start()
    return experiment
