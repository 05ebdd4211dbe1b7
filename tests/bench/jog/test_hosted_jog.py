"""By hand in a process of its own, as the screen has it: nudged from afar, stopped when nobody is there any more."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import ExitCode
from norton_bench.events import Ended, Note, PartMeasured, SessionEvent
from norton_bench.jog.by_hand import Jog
from norton_bench.recording.reader import read_recording
from norton_bench.session.hosted import HostedSession
from norton_bench.session.operator import Order
from tests.bench.half_rate import half_rate

pytestmark = pytest.mark.long

RIG = half_rate("sim-odrive")
WAIT_S = 120.0


def until(session: HostedSession, enough: Callable[[SessionEvent], bool]) -> list[SessionEvent]:
    """All events up to the first that is ``enough``, and what came with it."""
    heard: list[SessionEvent] = []
    end = time.monotonic() + WAIT_S
    while not any(map(enough, heard)):
        assert time.monotonic() < end, heard[-3:]
        heard += session.events()
        time.sleep(0.01)
    return heard


def commands(at_least: float) -> Callable[[SessionEvent], bool]:
    return lambda event: isinstance(event, PartMeasured) and bool(np.any(event.measured.ticks["command"] >= at_least))


def test_it_is_nudged_from_afar_and_ends_at_zero(tmp_path: Path) -> None:
    with HostedSession(RIG, Jog(), out=tmp_path, seed=1) as session:
        until(session, lambda event: isinstance(event, PartMeasured) and len(event.measured.ticks) > 0)
        session.order(Order("jog", "actuator 0.1"))
        heard = until(session, commands(0.049))
        segment = next(event.measured.segments[-1] for event in reversed(heard) if commands(0.049)(event))
        assert segment.name == "actuator +0.05 N*m, load coasts"
        session.order(Order("jog", "end"))
        heard = until(session, lambda event: isinstance(event, Ended))
    end = heard[-1]
    assert isinstance(end, Ended)
    assert end.exit_code == ExitCode.OK
    assert end.recording is not None
    recording = read_recording(end.recording)
    assert recording.complete
    assert recording.metadata["session"] == "jog"
    assert recording.measured.ticks["command"][-1] == 0.0
    assert not any(isinstance(event, Note) and "final fit" in event.text for event in heard)


def test_a_watcher_that_hangs_or_leaves_stops_it(tmp_path: Path) -> None:
    """One that hangs sends no key: all goes to zero. One that is gone ends it, and the recording is whole."""
    session = HostedSession(RIG, Jog(dead_man_s=1.5), out=tmp_path, seed=1)
    until(session, lambda event: isinstance(event, PartMeasured) and len(event.measured.ticks) > 0)
    session.order(Order("jog", "actuator 0.1"))
    until(session, lambda event: isinstance(event, PartMeasured) and "no key for 1.5 s" in str(event.measured.events))
    session.order(Order("jog", "actuator 0.1"))
    until(session, commands(0.049))
    session.close()
    assert not session.running
    recording = read_recording(tmp_path / "sim-odrive.mcap")
    assert recording.complete
    assert any("no key for 1.5 s" in event.text for event in recording.measured.events)
    (stop,) = (event for event in recording.measured.events if event.kind == "stop")
    assert "has left" in stop.text
