"""A real experiment, made once: the engine runs a short session on a simulated bench; its recording is replayed."""

import asyncio
import inspect
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from norton_bench.events import Ended, SessionEvent
from norton_bench.recording.contents import Recording
from norton_bench.rig.rig import Rig
from norton_bench.screen.experiment import Experiment, Replayed
from norton_bench.session.operator import Order
from norton_bench.session.replay import Replay, load_replay
from tests.bench.whole_session import RIG, SESSION, Performed, whole_session


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Tests that drive an app are coroutines; each has a loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    arguments = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    asyncio.run(pyfuncitem.obj(**arguments))
    return True


ROOT = Path(__file__).parents[3]
RIGS = ROOT / "rigs"


@dataclass
class Clock:
    """Seconds that pass when told."""

    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class Stand:
    """A session as the screen sees one: its events are those of a recording, and it keeps what is asked of it."""

    replay: Replay
    orders: list[Order] = field(default_factory=list)
    stops: list[str] = field(default_factory=list)
    closed: bool = False
    next_events: list[SessionEvent] = field(default_factory=list)  # beside those of the replay

    def events(self) -> list[SessionEvent]:
        events = [*self.replay.events(), *self.next_events]
        self.next_events.clear()
        return events

    def order(self, order: Order) -> None:
        self.orders.append(order)

    def stop(self, reason: str) -> None:
        self.stops.append(reason)

    def close(self) -> None:
        self.closed = True


@pytest.fixture(scope="session")
def performed(tmp_path_factory: pytest.TempPathFactory) -> Performed:
    return whole_session(tmp_path_factory)


@pytest.fixture(scope="session")
def recorded(performed: Performed) -> Recording:
    return load_replay(performed.result.recording)[1]


@pytest.fixture
def rig() -> Rig:
    return RIG


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def replayed(performed: Performed, recorded: Recording, clock: Clock) -> Experiment:
    """The recording being replayed, in time that the test moves."""
    replay = Replay(recorded, clock=clock)
    experiment = Experiment(RIG, "sim-odrive.mcap", lambda: Replayed(replay, performed.result.recording))
    experiment.start()
    return experiment


@pytest.fixture
def session(recorded: Recording, clock: Clock) -> Stand:
    return Stand(Replay(recorded, clock=clock))


@pytest.fixture
def live(session: Stand) -> Experiment:
    """An experiment that waits to be started; its session is ``session``."""
    return Experiment(RIG, SESSION.place, lambda: session)


def in_fixed_places(summary: Ended) -> Ended:
    """The same with files whose names do not change from run to run."""
    runs = Path("runs/20260102-030405-sim-odrive")
    names = {name: getattr(summary, name) for name in ("recording", "network", "report")}
    return replace(summary, **{name: runs / path.name for name, path in names.items() if path is not None})
