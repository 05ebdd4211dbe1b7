"""What the loop keeps of a tick is what really happened on the wires."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.control.admittance import AdmittanceController
from norton_bench.errors import SafetyStopError
from norton_bench.loop.loop import HELD_S
from norton_bench.loop.outbox import Outbox
from norton_bench.procedures.waves import Motion, coasting, imposed, pushed
from norton_bench.records import NO_SEGMENT, TICK, join
from norton_bench.rig.load import load_rig
from norton_bench.segments import PRESCRIBED_MOTION, Admittance, LoadMode, Segment, Use
from tests.bench.bench_in_simulation import Bench, opened
from tests.bench.control.plant import PlantSettings

TICK_S = 1e-3
RIGS = Path(__file__).parents[3] / "rigs"


@pytest.mark.parametrize(
    ("rig_file", "command", "carried", "load_carried"),
    [
        ("sim-odrive.toml", 0.1, float(np.float32(0.1)), float(np.float32(0.05))),
        ("sim-vesc.toml", 0.12345, 0.123, float(np.float32(0.05))),  # whole milliamperes
        ("sim-vesc.toml", 0.009, 0.0, float(np.float32(0.05))),  # less than the drive's minimum
        ("sim-mit.toml", 0.12345, -2 + 2174 * 4 / 4095, float(np.float32(0.05))),  # the nearest of 4096 codes
        ("sim-mit.toml", 0.0, -2 + 2048 * 4 / 4095, float(np.float32(0.05))),  # which is never quite zero
    ],
)
def test_commands_are_recorded_as_the_wire_carries_them(
    rig_file: str, command: float, carried: float, load_carried: float
) -> None:
    segment = pushed("test", "push", Use.PREPARE, np.full(20, 0.05), np.full(20, command))
    with opened(load_rig(RIGS / rig_file)) as bench, bench.loop.running():
        ticks = bench.loop.run(segment).ticks
    assert ticks["command"] == pytest.approx(carried, abs=1e-12)
    assert ticks["load_torque_nm"] == pytest.approx(load_carried, abs=1e-12)
    assert set(ticks["wished_load_torque_nm"]) == {0.05}


# ---- Between two segments, while the session is awaited -------------------------------------------------------------


class Late:
    """An order that is there after so many looks."""

    def __init__(self, looks: int) -> None:
        self.left = looks

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


def turning(ticks: int, speed_rad_s: float) -> Segment:
    """Up to a speed in half the time, then on at it."""
    velocity = speed_rad_s * np.minimum(np.arange(ticks) / (ticks // 2), 1.0)
    motion = Motion(np.cumsum(velocity) * TICK_S, velocity, np.gradient(velocity, TICK_S))
    return imposed("test", "turn", Use.PREPARE, np.full(ticks, 0.01), motion)


def controlled(bench: Bench) -> AdmittanceController:
    """With a controller, as after a calibration."""
    limit_nm = bench.loop.guard.limits.load_torque_nm
    bench.loop.controller = AdmittanceController(PlantSettings().calibration(), TICK_S, limit_nm)
    return bench.loop.controller


def acting(law: Admittance, ticks: int) -> Segment:
    return Segment("test", "act", Use.PREPARE, np.full(ticks, 0.1), LoadMode.ADMITTANCE, law)


def test_a_late_session_finds_the_last_command_and_no_tick_missing() -> None:
    push = coasting("test", "push", Use.PREPARE, np.full(50, 0.03))
    rig = load_rig(RIGS / "sim-odrive.toml")
    with opened(rig) as bench, bench.loop.running():
        bench.loop.hold(Late(5))  # before the first segment: at rest
        bench.loop.run(push)
        bench.loop.hold(Late(300))
        second = bench.loop.run(push)
    kept = rig.limits.stall_after_ns // rig.tick_ns
    ticks = join(bench.parts).ticks
    assert list(np.unique(ticks["segment"], return_counts=True)[1]) == [305, 50, 50]
    waited = ticks[ticks["segment"] == NO_SEGMENT]
    assert np.all(waited["command"][:5] == 0.0)
    assert waited["command"][5 : 5 + kept] == pytest.approx(0.03)
    assert np.all(waited["command"][5 + kept :] == 0.0)
    assert set(np.diff(ticks["tick_ns"])) == {bench.rig.tick_ns}
    assert [segment.index for segment in join(bench.parts).segments] == [0, 1]
    assert second.segments[0].start_ns == ticks["tick_ns"][ticks["segment"] == 1][0]


def test_a_segment_that_ended_for_its_speed_is_held_without_any_push() -> None:
    """What made it fast would make it faster, and its array goes on to commands that were never given."""
    ramp = coasting("test", "search", Use.PREPARE, np.linspace(0.0, 0.5, 3000), stop_at_velocity_rad_s=10.0)
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench, bench.loop.running():
        bench.loop.run(ramp)
        bench.loop.hold(Late(50))
        bench.loop.run(coasting("test", "push", Use.PREPARE, np.full(5, 0.01)))
        bench.loop.hold(Late(3))
    ticks = join(bench.parts).ticks
    waited = ticks[ticks["segment"] == NO_SEGMENT]
    assert len(waited) == 53
    assert not waited["command"][:50].any()
    assert np.max(waited["velocity_rad_s"]) < 12.0
    assert waited["command"][50:] == pytest.approx(0.01)  # nothing was too fast any more


def test_a_place_stays_commanded_after_a_segment_that_ended_for_its_speed() -> None:
    """The shaft of a spring would jump back to zero, until the session says what comes next."""
    reach = pushed("test", "reach", Use.PREPARE, np.zeros(500), np.full(500, 0.1), stop_at_velocity_rad_s=1.0)
    with opened(load_rig(RIGS / "sim-series-elastic.toml")) as bench, bench.loop.running():
        bench.loop.run(reach)
        bench.loop.hold(Late(20))
    ticks = join(bench.parts).ticks
    assert len(ticks[ticks["segment"] == 0]) < 500
    assert ticks["command"][ticks["segment"] == NO_SEGMENT] == pytest.approx(0.1)


def test_a_prescribed_motion_goes_on_at_its_last_velocity() -> None:
    rig = load_rig(RIGS / "sim-odrive.toml")
    with opened(rig) as bench, bench.loop.running():
        controlled(bench)
        bench.loop.run(turning(400, 10.0))
        bench.loop.hold(Late(200))
        bench.loop.run(imposed("test", "on", Use.PREPARE, np.zeros(1)))
    ticks = join(bench.parts).ticks
    waited = ticks[ticks["segment"] == NO_SEGMENT]
    assert len(waited) == 200
    assert set(waited["reference_velocity_rad_s"]) == {10.0}
    whole = ticks["reference_position_rad"][200:600]  # at full speed, and then waiting: one straight line
    assert np.diff(whole) == pytest.approx(10.0 * TICK_S, abs=1e-9)
    assert ticks["reference_position_rad"][600] == pytest.approx(whole[-1], abs=1e-9)
    assert np.mean(waited["load_velocity_rad_s"][100:]) == pytest.approx(10.0, abs=0.5)


def test_a_spring_keeps_its_place_from_segment_to_segment() -> None:
    """Also where the load's body gets another mass; a motion that is imposed then begins where the load stands."""
    laws = (Admittance(5e-4, 2e-2, 0.5), Admittance(5e-4, 2e-2, 0.5), Admittance(1e-3, 3e-2, 0.5), PRESCRIBED_MOTION)
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench, bench.loop.running():
        controlled(bench)
        for law in laws:
            bench.loop.run(acting(law, 600))
            bench.loop.hold(Late(2))
    ticks = join(bench.parts).ticks
    place, centre = ticks["load_position_rad"], ticks["reference_position_rad"]
    sprung, held = slice(0, 1800), slice(1810, None)
    assert np.ptp(centre[sprung]) == 0.0
    # The actuator's torque less its friction, on the spring.
    assert 0.1 < place[1790] - centre[0] < 0.2
    assert np.max(np.abs(np.diff(ticks["load_velocity_rad_s"][500:]))) < 0.5
    assert np.ptp(place[1790:]) < 0.01
    assert centre[held] == pytest.approx(place[1805], abs=0.01)


def test_a_spring_that_is_let_go_goes_without_a_jump() -> None:
    """Its place stays while it goes; one that comes later has its place where the load stands then."""
    spring, none = Admittance(5e-4, 2e-2, 0.5), Admittance(5e-4, 2e-2)
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench, bench.loop.running():
        controlled(bench)
        bench.loop.run(acting(spring, 600))
        for law in (none, none, none, none, spring):
            bench.loop.run(acting(law, 200))
    ticks = join(bench.parts).ticks
    place, centre = ticks["load_position_rad"], ticks["reference_position_rad"]
    gone = slice(600, 1400)
    assert np.ptp(centre[:1400]) == 0.0
    # By the law the velocity changes by no more than the port's torque moves the mass in a tick, from below 1 rad/s.
    assert np.max(np.abs(np.diff(ticks["load_velocity_rad_s"][gone]))) < 0.3
    assert place[1399] - place[600] > 0.5
    assert centre[1400] == pytest.approx(place[1399], abs=0.02)


@pytest.mark.parametrize("wall_rad", [None, -0.1])
def test_a_wall_that_goes_or_moves_leaves_no_deflection(wall_rad: float | None) -> None:
    """On its free side the load may be anywhere; all of that would be a deflection at once."""
    wall = Admittance(5e-4, 2e-2, 2.0, wall_rad=10.0)
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench, bench.loop.running():
        controlled(bench)
        bench.loop.run(acting(wall, 800))
        bench.loop.run(acting(Admittance(5e-4, 2e-2, 2.0, wall_rad=wall_rad), 20))
    ticks = join(bench.parts).ticks
    assert ticks["load_position_rad"][799] - ticks["reference_position_rad"][799] > 1.0
    assert ticks["reference_position_rad"][800] == pytest.approx(ticks["load_position_rad"][799], abs=0.02)
    assert np.max(np.abs(np.diff(ticks["load_velocity_rad_s"][790:]))) < 0.5


def test_after_the_drives_were_idle_a_body_begins_where_the_shaft_is() -> None:
    law = Admittance(5e-4, 2e-2)
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench:
        controller = controlled(bench)
        with bench.loop.running():
            bench.loop.run(acting(law, 300))
        body = controller._body
        with bench.loop.running():
            bench.loop.run(acting(law, 5))
    assert controller._body is not body


def test_a_spring_after_an_imposed_motion_has_its_place_where_the_load_stands() -> None:
    """It may have been left behind, by more than its torque could take along."""
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench, bench.loop.running():
        bench.loop.controller = AdmittanceController(PlantSettings().calibration(), TICK_S, 1e-3)
        bench.loop.run(turning(400, 10.0))
        bench.loop.run(acting(Admittance(5e-4, 2e-2, 0.5), 5))
    ticks = join(bench.parts).ticks
    assert ticks["reference_position_rad"][399] - ticks["load_position_rad"][399] > 0.5
    assert ticks["reference_position_rad"][400] == pytest.approx(ticks["load_position_rad"][399], abs=1e-2)


@pytest.mark.long
def test_it_is_not_held_for_ever() -> None:
    with (
        opened(load_rig(RIGS / "sim-odrive.toml")) as bench,
        pytest.raises(
            SafetyStopError, match=r"within 5 s what comes after a segment: .* decide with the drives"
        ) as stop,
        bench.loop.running(),
    ):
        bench.loop.hold(lambda: False)
    assert stop.value.by == "stall"
    assert len(join(bench.parts).ticks) == round(HELD_S / TICK_S)
    assert bench.armed() == []


def test_it_is_guarded_while_it_is_held() -> None:
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench:
        bench.after(0.2, lambda: bench.force_torque(100.0))
        with pytest.raises(SafetyStopError, match="torque") as stop, bench.loop.running():
            bench.loop.hold(lambda: False)
        assert stop.value.by != "stall"
        assert bench.armed() == []


def test_a_row_has_the_columns_of_the_table_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    rows: list[list[str]] = []
    put = Outbox.put
    monkeypatch.setattr(
        Outbox, "put", lambda self, row, arrivals: (rows.append(list(row)), put(self, row, arrivals))[1]
    )
    with opened(load_rig(RIGS / "sim-odrive.toml")) as bench, bench.loop.running():
        bench.loop.run(coasting("test", "rest", Use.PREPARE, np.zeros(1)))
    assert rows == [list(TICK.names or ())]


# ---- What the controller is told -------------------------------------------------------------------------------------


class Listening(AdmittanceController):
    """Keeps what it is told of the load's torque."""

    def note_sent(self, load_torque_nm: float) -> None:
        self.__dict__.setdefault("told_nm", []).append(load_torque_nm)
        super().note_sent(load_torque_nm)


def test_the_controller_is_told_what_was_sent_not_what_was_wished() -> None:
    """Clipped by the guard, and rounded as the wire carries it; also for ticks that were missed meanwhile."""
    rig = load_rig(RIGS / "sim-odrive.toml")
    limit_nm, missed = rig.limits.load_torque_nm, 7
    wished_nm = np.repeat([0.05, 3.0 * limit_nm, -0.04, 0.03], 5)
    with opened(rig) as bench, bench.loop.running():
        bench.loop.controller = Listening(PlantSettings().calibration(), TICK_S, limit_nm)
        bench.after(12.5 * TICK_S, lambda: bench.backend.clock.stall(round(missed * TICK_S * 1e9)))
        ticks = bench.loop.run(pushed("test", "push", Use.PREPARE, wished_nm, np.zeros(len(wished_nm)))).ticks
        told_nm = bench.loop.controller.told_nm
    assert np.max(ticks["load_torque_nm"]) == pytest.approx(limit_nm)
    assert len(told_nm) == len(wished_nm)
    passed = ((ticks["tick_ns"] - ticks["tick_ns"][0]) // bench.rig.tick_ns).astype(int)
    assert np.max(np.diff(passed)) == missed
    # A tick that was missed is told as the one before it: that command acted on.
    last = np.searchsorted(passed, np.arange(len(told_nm)), side="right") - 1
    assert told_nm == list(ticks["load_torque_nm"][last])
