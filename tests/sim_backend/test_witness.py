"""What is true, whatever the devices say."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from norton_bench.faults.host_loss import last_state, read_witness
from norton_drivers.link import Link
from norton_drivers.odrive import open_amplifier
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.faults.schema import FalseReading, Freeze
from norton_sim.witness import Standstills, WitnessFile

MS = 1_000_000


def told(stamps_ms: list[float]) -> str:
    standstills = Standstills()
    for stamp_ms in stamps_ms:
        standstills.goes_on(round(stamp_ms * MS))
    return str(standstills)


def test_who_was_never_late_says_so() -> None:
    assert told([100.0, 100.3, 102.3]) == "the simulated devices stood still for 2.0 ms at most"


def test_what_real_devices_would_not_have_done_is_counted() -> None:
    assert "for 12.0 ms at most, and for more than 5 ms once:" in told([0.0, 12.0, 12.3])
    assert "for 40.0 ms at most, and for more than 5 ms 2 times:" in told([0.0, 40.0, 47.0])


Bench = Callable[..., SimulatedBackend]


def drive(backend: SimulatedBackend, wiring: Wiring) -> None:
    """The actuator alone is enabled, drives for 100 ms, and is commanded nothing for 20 ms."""
    link = Link(backend, wiring.buses)
    actuator = open_amplifier(wiring.actuator, link)
    actuator.enable()
    for torque_nm, ticks in ((0.2, 100), (0.0, 20)):
        for _ in range(ticks):
            actuator.command(torque_nm)
            link.wait()


def test_the_witness_sees_through_lying_sensors(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    backend.inject(Freeze(on="actuator"), Freeze(on="load"), FalseReading(on="torque_sensor", torque_nm=0.0))
    states = backend.watch()
    drive(backend, wiring)
    driving = [state for state in states if state.driving]
    assert {state.driving for state in driving} == {("actuator",)}
    assert (driving[-1].stamp_ns - driving[0].stamp_ns) / MS == pytest.approx(100, abs=1)
    assert states[-1].armed == ("actuator",)
    assert states[-1].driving == ()
    assert max(state.velocity_rad_s for state in states) > 20
    assert max(state.torque_nm for state in states) > 0.05
    assert states[0].armed == ()
    assert {later.stamp_ns - earlier.stamp_ns for earlier, later in pairwise(states)} == {250_000}


def test_a_witness_file_tells_the_same_and_is_read_while_it_grows(
    wiring: Wiring, open_bench: Bench, tmp_path: Path
) -> None:
    backend = open_bench(wiring)
    states = backend.watch()
    witness = WitnessFile(tmp_path / "truth.csv", backend.world, epoch_ns=7_000_000_000)
    drive(backend, wiring)
    half_way = read_witness(tmp_path / "truth.csv")
    witness.close()
    whole = read_witness(tmp_path / "truth.csv")
    assert len(whole) >= len(half_way) > 200
    assert last_state(tmp_path / "truth.csv") == whole[-1]
    by_stamp = {state.stamp_ns: state for state in states}
    for written in whole:
        true = by_stamp[written.stamp_ns - 7_000_000_000]
        assert written[1:4] == pytest.approx(true[1:4], rel=1e-5)
        assert written[4:] == true[4:]


def test_a_line_that_is_half_written_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("names\n1,0.5,1,2,actuator+load,actuator\n2,0.5,1,2,act")
    (state,) = read_witness(path)
    assert (state.stamp_ns, state.driving, state.armed) == (1, ("actuator", "load"), ("actuator",))
    assert last_state(path) == state
    for nothing in ("", "names\n", "names\n1,0.5"):
        path.write_text(nothing)
        assert read_witness(path) == []
        assert last_state(path) is None
