"""The understudy decides what was decided, one tick later, and nothing of that reaches the stage."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bench.faults.rehearse import prepare
from bench.loop.played import Played
from bench.loop.understudy import MOST_BEHIND, Understudy
from bench.procedures.imposed import imposed_multisine
from bench.procedures.makers import coasting, imposed
from bench.rig.load import load_rig
from bench.segments import Use
from bench.session.supervision import learned
from drivers.clock import Clock
from tests.bench.bench_in_simulation import Bench, opened

RIG_FILE = Path(__file__).parents[3] / "rigs" / "sim-odrive.toml"
AWAKE_NS = 300_000


@dataclass
class AwakeClock:
    """Simulated time, which waits as a machine's clock does: awake before the deadline."""

    clock: Clock

    def now_ns(self) -> int:
        return self.clock.now_ns()

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        self.clock.wait_until_ns(deadline_ns - AWAKE_NS)
        if awake is not None:
            awake()
        self.clock.wait_until_ns(deadline_ns)


@pytest.fixture
def played_again(monkeypatch: pytest.MonkeyPatch) -> list[Played]:
    again: list[Played] = []
    play = Understudy.play

    def listened(self: Understudy) -> Played:
        again.append(play(self))
        return again[-1]

    monkeypatch.setattr(Understudy, "play", listened)
    return again


def rehearsing(bench: Bench) -> None:
    bench.loop.rehearses, bench.loop._clock = True, AwakeClock(bench.devices.clock)


def test_it_decides_bit_for_bit_what_was_decided(played_again: list[Played]) -> None:
    """Guard and controller, over two segments, one of which began with ticks that were missed."""
    rig = load_rig(RIG_FILE)
    known = prepare(rig).known
    segment = imposed("test", "motion", Use.PREPARE, np.zeros(300), imposed_multisine(known, 0.1, 0.3, seed=1))
    with opened(rig) as bench:
        rehearsing(bench)
        bench.loop.learn(learned(known))
        with bench.loop.running():
            coasted = bench.loop.run(coasting("test", "coast", Use.PREPARE, np.full(50, 0.01))).ticks
            bench.devices.clock.wait_until_ns(bench.devices.clock.now_ns() + 5_000_000)
            moved = bench.loop.run(segment).ticks
    wished = np.concatenate([coasted["wished_load_torque_nm"], moved["wished_load_torque_nm"]])[:-1]
    assert np.ptp(wished) > 0.01
    decided = np.array([played.wish.load_torque_nm for played in played_again])
    assert len(decided) >= len(wished) - 1  # before the tick that was late there was no time
    assert decided.tobytes() == wished[: len(decided)].tobytes()
    assert any(played.missed > 0 for played in played_again)


def test_the_drives_and_the_guard_notice_nothing_of_it() -> None:
    def ticks(*, rehearses: bool) -> bytes:
        with opened(load_rig(RIG_FILE)) as bench:
            rehearsing(bench)
            bench.loop.rehearses = rehearses
            with bench.loop.running():
                table = bench.loop.run(coasting("test", "coast", Use.PREPARE, np.full(100, 0.05))).ticks
        return table.tobytes()

    assert ticks(rehearses=True) == ticks(rehearses=False)


def test_it_is_left_alone_where_there_is_never_time_for_it(played_again: list[Played]) -> None:
    """In lock step nobody waits."""
    with opened(load_rig(RIG_FILE)) as bench:
        bench.loop.rehearses = True
        with bench.loop.running():
            bench.loop.run(coasting("test", "coast", Use.PREPARE, np.zeros(MOST_BEHIND + 10)))
            assert bench.loop._understudy is not None
            assert not bench.loop._understudy.behind
    assert played_again == []
