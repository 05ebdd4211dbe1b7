"""A look at benches that are not wired as their rig file says: each is told in a sentence with the mend."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import pytest

from norton_bench.check.check import Permission, check_rig, look
from norton_bench.check.moving import check_moving
from norton_bench.check.survey import RigCheck
from norton_bench.errors import OperatorStopError
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_drivers import dbc_sensor
from norton_drivers.codecs.can_errors import ErrorClass
from norton_drivers.codecs.odrive import AxisState, MessageId, SetInputTorque, arbitration_id
from norton_sim.backend import SimulatedBackend, open_backend

RIGS = Path(__file__).parents[3] / "rigs"
RIG, DBC = load_rig(RIGS / "sim-odrive.toml"), load_rig(RIGS / "sim-dbc.toml")

Open = Callable[[Rig], SimulatedBackend]


@pytest.fixture
def opened() -> Iterator[Open]:
    """``opened(rig)``: the simulated bench that is really there, as ``rig`` says."""
    with ExitStack() as stack:

        def open_it(rig: Rig) -> SimulatedBackend:
            backend = open_backend(rig.wiring, rig.simulated, seed=1, place="r.toml")
            stack.callback(backend.close)
            return backend

        yield open_it


def wired(rig: Rig, role: str, **changed: Any) -> Rig:
    """``rig`` with other settings for one device; options are merged."""
    device = getattr(rig.wiring, role)
    options = {**device.options, **changed.pop("options", {})}
    return replace(rig, wiring=replace(rig.wiring, **{role: replace(device, options=options, **changed)}))


def sentences(found: RigCheck) -> list[str]:
    return [str(problem) for problem in found.problems()]


def test_a_bench_in_order(opened: Open) -> None:
    found = look(RIG, opened(RIG))
    assert sentences(found) == []
    (bus,) = found.buses
    assert [(sender.role, sender.options) for sender in bus.senders] == [
        ("actuator", {"node": 1}),
        ("load", {"node": 2}),
    ]
    assert (bus.strangers, bus.troubles) == ((), {})
    # Two encoders at 1 kHz, currents at 100 Hz, three slow messages of each at 10 Hz; most carry eight bytes.
    assert bus.rate_hz == pytest.approx(2 * (1000 + 100 + 30), rel=0.02)
    assert bus.load == pytest.approx(0.26, abs=0.02)
    actuator = found.devices[0]
    assert actuator.answer_s == pytest.approx(500e-6, abs=200e-6)  # there and back, 250 µs each way
    assert actuator.identity is not None
    assert actuator.identity.firmware == "0.6.10"


def test_a_wrong_node_is_told_with_the_one_that_is_heard(opened: Open) -> None:
    found = look(wired(RIG, "actuator", options={"node": 5}), opened(wired(RIG, "actuator", options={"node": 3})))
    (sentence,) = sentences(found)
    assert sentence == (
        "[actuator] odrive on bus can0: nobody is heard at node = 5, but an ODrive at node = 3 (heartbeat): "
        "set node = 3, or give the device node = 5"
    )


def test_of_several_strangers_all_are_named(opened: Open) -> None:
    there = wired(wired(RIG, "actuator", options={"node": 3}), "load", options={"node": 4})
    found = sentences(look(RIG, opened(there)))
    assert len(found) == 2
    assert all("an ODrive at node = 3 (heartbeat) and an ODrive at node = 4 (heartbeat)" in each for each in found)
    assert all("set the one that is meant" in each for each in found)


def test_a_device_that_is_off_among_others(opened: Open) -> None:
    backend = opened(RIG)
    backend.world.wires["load"].cut()
    (sentence,) = sentences(look(RIG, backend))
    assert sentence == (
        "[load] odrive on bus can0: does not answer; only [actuator] can be heard: is it powered, and on this bus?"
    )


def test_a_dead_bus(opened: Open) -> None:
    backend = opened(DBC)
    for plug in backend.world.wires.values():
        plug.cut()
    found = sentences(look(DBC, backend))
    assert len(found) == 3
    assert all("not one frame is heard: check power, cable and termination" in each for each in found)


def test_a_driver_of_another_maker(opened: Open) -> None:
    there = wired(RIG, "actuator", options={"node": 3})
    rig = replace(DBC, wiring=replace(DBC.wiring, actuator=replace(DBC.wiring.actuator, driver="dbc")))
    sensor_only = replace(
        rig, wiring=replace(rig.wiring, load=None, torque_sensor=DBC.wiring.torque_sensor, actuator=RIG.wiring.load)
    )
    (sentence,) = [each for each in sentences(look(sensor_only, opened(there))) if "torque_sensor" in each]
    assert 'heard instead: an ODrive (driver = "odrive", node = 3); is driver right' in sentence


def test_another_message_of_the_dbc_file(opened: Open, tmp_path: Path) -> None:
    shipped = (Path(dbc_sensor.__file__).parent / "dbc" / "torque-sensor.dbc").read_text()
    other = tmp_path / "mine.dbc"
    other.write_text(shipped + '\nBO_ 802 Other: 8 Sensor\n SG_ Torque : 0|32@1- (0.000001,0) [0|0] "Nm" Vector__XXX\n')
    there = wired(DBC, "torque_sensor", options={"dbc": str(other)})
    rig = wired(there, "torque_sensor", options={"message": "Other", "counter": None, "status": None})
    (sentence,) = sentences(look(rig, opened(there)))
    assert 'the device that mine.dbc describes at message = "TorqueReading"' in sentence


def test_two_devices_with_one_node(opened: Open) -> None:
    there = wired(RIG, "load", options={"node": 1})
    found = sentences(look(RIG, opened(there)))
    assert (
        "bus can0: two devices share the address of [actuator] (each question has two answers); "
        "give each one of its own"
    ) in found
    assert any(each.startswith("[load] odrive on bus can0: does not answer; only [actuator]") for each in found)


def test_two_devices_with_one_node_where_nobody_was_asked(opened: Open) -> None:
    """The doubled node is not one of the rig's: its heartbeats alone tell."""
    there = wired(wired(RIG, "load", options={"node": 7}), "actuator", options={"node": 7})
    found = sentences(look(RIG, opened(there), watch_s=1.5))
    assert any("two devices share the address of an ODrive at node = 7 (0x0E1 comes from two" in each for each in found)


def test_two_encoders_at_one_node_contradict_each_other(opened: Open) -> None:
    there = wired(RIG, "load", options={"node": 1})
    backend = opened(there)
    backend.world.plant._state[1, 0] += 0.7  # the load's shaft stands elsewhere
    found = sentences(look(RIG, backend))
    assert any("[actuator] motion readings jump to and fro between two values" in each for each in found)


def test_somebody_else_commands_the_drive(opened: Open) -> None:
    backend = opened(RIG)
    message = SetInputTorque(0.0)
    for delay_ns in range(0, 2_000_000_000, 50_000_000):
        backend.world.at(
            delay_ns,
            lambda _now: backend._can_wires["can0"].to_host(
                arbitration_id(1, MessageId.SET_INPUT_TORQUE), message.encode(), False, False
            ),
        )
    (sentence,) = sentences(look(RIG, backend))
    assert sentence.startswith("bus can0: somebody else commands [actuator] (0x02E); stop the other program")


def test_errors_on_the_bus_are_remarked(opened: Open) -> None:
    backend = opened(RIG)
    tell = error_teller(backend, ErrorClass.NO_ACKNOWLEDGEMENT)
    for delay_ns in range(0, 100_000_000, 10_000_000):
        backend.world.at(delay_ns, lambda _now: tell())
    found = look(RIG, backend)
    assert (sentences(found), found.remarks) == ([], ("bus can0: no acknowledgement, 10 times while it was watched",))


def test_errors_alone_point_to_the_bitrate(opened: Open) -> None:
    backend = opened(DBC)
    for plug in backend.world.wires.values():
        plug.cut()
    tell = error_teller(backend, ErrorClass.BUS_ERROR)
    backend.world.every(1_000_000, lambda _now: tell(), first_ns=0)
    found = sentences(look(DBC, backend))
    assert all("not one frame is heard, but errors are (bus error " in each for each in found)
    assert all("bitrate = 1000000 bit/s is probably not the devices'" in each for each in found)


def test_a_bus_off_while_watched(opened: Open) -> None:
    backend = opened(RIG)
    tell = error_teller(backend, ErrorClass.BUS_OFF)
    backend.world.at(400_000_000, lambda _now: tell())
    assert any("has left the bus after too many errors" in each for each in sentences(look(RIG, backend)))


def error_teller(backend: SimulatedBackend, classes: ErrorClass) -> Callable[[], None]:
    message = can.Message(arbitration_id=int(classes), data=bytes(8), is_error_frame=True, is_extended_id=False)

    def tell() -> None:
        for inbox in backend._can_wires["can0"]._inboxes:
            inbox.append((backend.world.now_ns, message))

    return tell


def test_a_rig_that_is_too_busy_for_its_bus(opened: Open) -> None:
    busy, overfull = (
        replace(RIG, wiring=replace(RIG.wiring, buses=(replace(RIG.wiring.buses[0], bitrate_bit_s=bitrate_bit_s),)))
        for bitrate_bit_s in (300_000, 200_000)
    )
    found = look(busy, opened(busy))
    (remark,) = found.remarks
    assert ("of its 300000 bit/s are taken" in remark, sentences(found)) == (True, [])
    found = look(overfull, opened(overfull))
    (sentence,) = sentences(found)
    assert found.remarks == ()
    assert "bus can0: its devices send 1" in sentence
    assert "% of what 200000 bit/s can carry; raise bitrate in every device" in sentence


def test_check_rig_opens_the_rigs_own_backend() -> None:
    assert sentences(check_rig(RIG, seed=1)) == []


# ---- Moving ---------------------------------------------------------------------------------------------------------


def said_of(rig: Rig, **truth: dict[str, Any]) -> tuple[RigCheck, list[str]]:
    """``rig check --move`` of a bench that is as ``truth`` says; with what was said on the way."""
    simulated = {**rig.simulated, **{role: {**rig.simulated[role], **more} for role, more in truth.items()}}
    heard: list[str] = []
    return check_rig(replace(rig, simulated=simulated), seed=1, move=Permission(heard.append)), heard


def test_a_bench_in_order_moves_little_and_says_what_it_gives() -> None:
    found, heard = said_of(RIG)
    assert sentences(found) == []
    assert heard[0].startswith("moving: pushes that grow to at most 0.25 N*m from the actuator and 0.5 N*m")
    scales = [float(each.split("about ")[1].split()[0]) for each in found.moved if "about" in each]
    assert scales == [pytest.approx(0.95, abs=0.04), pytest.approx(0.9, abs=0.04)]


@pytest.mark.parametrize(
    ("truth", "words"),
    [
        ({"torque_sensor": {"mounted": -1}}, "reverse [torque_sensor] direction"),
        ({"load": {"mounted": 1}}, "reverse [load] direction"),
        ({"load": {"torque_gain": "2"}}, "[load] gives 1.9"),
        ({"load": {"torque_gain": "0.45"}}, "[load] gives 0.4"),
        ({"actuator": {"amplifier_gain": "40 A/(N*m)"}}, "[actuator] gives 1.9"),
        ({"actuator": {"amplifier_gain": "7 A/(N*m)"}}, "[actuator] gives 0.3"),
        ({"actuator": {"coulomb_torque": "0.9 N*m"}}, "is it locked?"),
    ],
)
def test_what_only_motion_shows(truth: dict[str, dict[str, Any]], words: str) -> None:
    (sentence,) = sentences(said_of(RIG, **truth)[0])
    assert words in sentence


def test_nothing_moves_where_something_is_wrong() -> None:
    hasty = replace(RIG, limits=replace(RIG.limits, stale_after_ns=500_000))
    found, heard = said_of(hasty)
    assert any("beyond stale_after = 0.5 ms" in each for each in sentences(found))
    assert (found.moved, heard) == ((), ["nothing is moved until what was found is mended"])


def test_the_operator_stops_it_with_idle_drives() -> None:
    backend = open_backend(RIG.wiring, RIG.simulated, seed=1, place="r.toml")
    asked: list[int] = []

    def stop() -> str | None:
        asked.append(1)
        return "enough" if len(asked) > 500 else None

    with pytest.raises(OperatorStopError):
        check_moving(RIG, backend, stop)
    states = [device.axis_state for role, device in backend.world.devices.items() if role != "torque_sensor"]  # type: ignore[attr-defined]
    assert states == [AxisState.IDLE, AxisState.IDLE]
    backend.close()


def test_a_free_shaft_and_a_clamped_one() -> None:
    alone = load_rig(RIGS / "sim-free-shaft.toml")
    assert check_rig(alone, seed=1, move=Permission(lambda _text: None)).moved == (
        "watchdog of actuator verified: 400 ms",
        "the actuator turned the shaft the right way",
    )
    clamped = replace(RIG, wiring=replace(RIG.wiring, load=None, shaft="clamped"))
    found = check_rig(clamped, seed=1, move=Permission(lambda _text: None))
    assert sentences(found) == []
    assert "only the torque sensor's can be seen" in found.moved[1]
    simulated = {**RIG.simulated, "torque_sensor": {**RIG.simulated["torque_sensor"], "mounted": -1}}
    wrong = check_rig(replace(clamped, simulated=simulated), seed=1, move=Permission(lambda _text: None))
    assert "reverse [torque_sensor] direction" in sentences(wrong)[0]
