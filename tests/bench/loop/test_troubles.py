"""What goes wrong without ending anything is told as events, counted and not too often; a bus-off ends everything."""

from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from norton_bench.loop.devices import Devices
from norton_bench.procedures.waves import coasting
from norton_bench.records import Event
from norton_bench.rig.load import load_rig
from norton_bench.segments import Use
from norton_drivers.codecs.can_errors import CanErrorFrame, ErrorClass
from norton_drivers.codecs.odrive import MessageId, arbitration_id
from norton_drivers.errors import ConnectionFailedError
from tests.bench.bench_in_simulation import Bench, opened

RIG = Path(__file__).parents[3] / "rigs" / "sim-odrive.toml"


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened(load_rig(RIG)) as made:
        yield made


def run(bench: Bench, duration_s: float) -> list[Event]:
    with bench.loop.running():
        bench.loop.run(coasting("test", "rest", Use.PREPARE, np.zeros(round(duration_s * 1e3))))
    return [event for part in bench.parts for event in part.events]


def error_on_the_bus(bench: Bench, classes: ErrorClass) -> Callable[[], None]:
    """The host's controller tells of an error."""
    arbitration_id, data = CanErrorFrame(classes).encode()
    message = can.Message(arbitration_id=arbitration_id, data=data, is_error_frame=True, is_extended_id=False)
    wire = bench.backend._can_wires["can0"]

    def tell() -> None:
        for inbox in wire._inboxes:
            inbox.append((bench.backend.world.now_ns, message))

    return tell


def test_a_quiet_bench_tells_nothing(bench: Bench) -> None:
    assert run(bench, 0.5) == []


def test_a_storm_of_errors_is_told_once_a_second_and_counted_to_the_last(bench: Bench) -> None:
    tell = error_on_the_bus(bench, ErrorClass.NO_ACKNOWLEDGEMENT)
    for index in range(250):
        bench.after(0.3 + 0.01 * index, tell)
    told = run(bench, 3.0)
    assert {event.kind for event in told} == {"bus"}
    assert told[0].text.startswith("bus can0: no acknowledgement, ")
    assert len(told) <= 4
    assert told[-1].text.endswith("(250 in all)")
    gaps_s = np.diff([event.stamp_ns for event in told[:-1]]) * 1e-9
    assert np.all(gaps_s >= 0.99)


def test_what_was_there_before_is_no_news(bench: Bench) -> None:
    error_on_the_bus(bench, ErrorClass.NO_ACKNOWLEDGEMENT)()
    bench.devices.link.poll()
    assert run(bench, 0.3) == []


def test_what_a_driver_cannot_decode_is_told(bench: Bench) -> None:
    cut_short = arbitration_id(1, MessageId.HEARTBEAT)
    bench.after(0.2, lambda: bench.backend.world.wires["actuator"].send(cut_short, b"\0"))  # type: ignore[call-arg]
    (event,) = run(bench, 0.5)
    assert (event.kind, event.text) == ("device", "[actuator]: messages that could not be decoded, once")


def test_a_bus_off_ends_with_idle_drives(bench: Bench) -> None:
    bench.after(0.2, error_on_the_bus(bench, ErrorClass.BUS_OFF))
    with pytest.raises(ConnectionFailedError, match="bus-off"):
        run(bench, 1.0)
    assert bench.armed() == []
    kinds = [event.kind for part in bench.parts for event in part.events]
    assert kinds == ["stop", "bus"]  # the reason, and the count; the drives were heard to go idle


def test_adapters_are_asked_once_a_second(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    link = bench.devices.link
    monkeypatch.setattr(link, "ask_adapters", lambda: asked.append(link.clock.now_ns()))
    run(bench, 2.5)
    assert len(asked) == 3
    assert isinstance(bench.devices, Devices)
