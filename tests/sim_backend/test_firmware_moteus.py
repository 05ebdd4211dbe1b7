"""The emulated moteus, driven by the frames that the maker's own package makes, and read by it."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import moteus
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from moteus.protocol import parse_registers

from norton_bench.rig.load import load_rig
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from norton_sim.firmware.moteus import MoteusBoard

MS = 1_000_000
RIG = Path(__file__).parents[2] / "rigs" / "sim-moteus.toml"
REGISTER, MODE = moteus.Register, moteus.Mode
AMPERES_PER_NM = 18.0
EVERYTHING = moteus.QueryResolution()
EVERYTHING.q_current = moteus.F32
EVERYTHING.fault = moteus.INT16
CONTROLLER = moteus.Controller(id=1, transport=object(), query_resolution=EVERYTHING)


class Host:
    """Sends what the maker's package makes."""

    def __init__(self, backend: SimulatedBackend, bus: can.BusABC) -> None:
        self.world, self.plant, self.bus = backend.world, backend.world.plant, bus
        firmware = backend.world.devices["actuator"]
        assert isinstance(firmware, MoteusBoard)
        self.firmware = firmware

    def wait(self, ms: float) -> None:
        self.world.advance(self.world.now_ns + round(ms * MS))

    def send(self, data: bytes, *, identifier: int = 0x8001, fd: bool = True) -> None:
        length = next(each for each in (*range(9), 12, 16, 20, 24, 32, 48, 64) if each >= len(data))
        padded = data.ljust(length, b"\x50")
        self.bus.send(can.Message(arbitration_id=identifier, data=padded, is_fd=fd, bitrate_switch=fd))

    def heard(self) -> list[can.Message]:
        return list(iter(lambda: self.bus.recv(0), None))

    def ask(self, data: bytes, **more: object) -> can.Message:
        self.heard()
        self.send(data, **more)  # type: ignore[arg-type]
        self.wait(1)
        (reply,) = self.heard()
        return reply

    def state(self, command: moteus.Command | None = None) -> dict[int, float]:
        """What it answers to a command of the package's, or to its question."""
        reply = self.ask((command or CONTROLLER.make_query()).data)
        assert reply.arbitration_id == 0x100
        return dict(parse_registers(reply.data).response)

    def torque(self, torque_nm: float, ms: int = 10, **more: float) -> None:
        made = CONTROLLER.make_position(
            position=math.nan, feedforward_torque=torque_nm, kp_scale=0.0, kd_scale=0.0, ilimit_scale=0.0, **more
        )
        for _ in range(ms // 10):
            self.send(made.data, identifier=0x0001)
            self.wait(10)

    @property
    def current_a(self) -> float:
        return self.plant.true_current_a("actuator")


OpenHost = Callable[..., Host]


@pytest.fixture
def open_host():
    backends: list[SimulatedBackend] = []

    def opened(**options: object) -> Host:
        rig = load_rig(RIG)
        actuator = replace(rig.wiring.actuator, options={**rig.wiring.actuator.options, **options})
        simulated = rig.simulated
        if (mode := options.get("mode")) in ("position", "velocity"):
            key, unit = ("stiffness", "rad") if mode == "position" else ("damping", "rad/s")
            gain = AMPERES_PER_NM * float(options[key])  # type: ignore[arg-type]
            simulated = {**simulated, "actuator": {**simulated["actuator"], "amplifier_gain": f"{gain} A/({unit})"}}
            wiring = replace(rig.wiring, actuator=actuator, command_unit=unit)
        else:
            wiring = replace(rig.wiring, actuator=actuator)
        backend = load_backend("simulated")(wiring, simulated, seed=1, place="here")
        backends.append(backend)
        return Host(backend, backend.open_can(wiring.buses[0]).bus)

    yield opened
    for backend in backends:
        backend.close()


@pytest.fixture
def host(open_host: OpenHost) -> Host:
    return open_host()


def test_it_speaks_only_when_it_is_asked(host: Host) -> None:
    host.torque(0.0, 200)
    assert host.heard() == []


def test_it_tells_its_state(host: Host) -> None:
    told = host.state()
    assert told[REGISTER.MODE] == MODE.STOPPED
    assert told[REGISTER.POSITION] == pytest.approx(host.plant.encoder_position_rad("actuator") / math.tau, abs=1e-4)
    assert (told[REGISTER.VOLTAGE], told[REGISTER.FAULT]) == (24.0, 0)
    assert told[REGISTER.TEMPERATURE] == 25.0


def test_a_reply_is_can_fd_where_the_question_was_or_where_it_is_long(host: Host) -> None:
    mode = bytes.fromhex("1100")
    assert host.ask(mode).is_fd
    assert not host.ask(mode, fd=False).is_fd
    assert host.ask(CONTROLLER.make_query().data, fd=False).is_fd
    assert host.ask(mode).bitrate_switch


@pytest.mark.parametrize("identifier", [0x8002, 0x18001, 0x0001])
def test_frames_to_others_and_without_a_question_have_no_answer(host: Host, identifier: int) -> None:
    host.send(CONTROLLER.make_query().data, identifier=identifier)
    host.wait(2)
    assert host.heard() == []


def test_prefix_broadcast_and_another_host(open_host: OpenHost) -> None:
    host = open_host(prefix=0x12, node=9)
    assert host.ask(b"\x11\x00", identifier=0x12_8309).arbitration_id == 0x12_0903
    assert host.ask(b"\x11\x00", identifier=0x12_807F).arbitration_id == 0x12_0900


def test_a_torque_starts_it_and_is_obeyed(host: Host) -> None:
    host.torque(0.1, 10)
    assert host.state()[REGISTER.MODE] not in (MODE.POSITION, MODE.STOPPED)
    assert host.current_a == 0.0
    host.torque(0.1, 100)
    assert host.state()[REGISTER.MODE] == MODE.POSITION
    assert host.current_a == pytest.approx(0.1 * AMPERES_PER_NM, rel=1e-3)
    assert host.state()[REGISTER.TORQUE] == pytest.approx(0.1, rel=0.05)
    host.torque(0.5, 50, maximum_torque=0.2)
    assert host.current_a == pytest.approx(0.2 * AMPERES_PER_NM, rel=1e-3)


def test_a_reply_tells_the_state_before_its_command(host: Host) -> None:
    host.torque(0.0, 50)
    assert host.state(CONTROLLER.make_stop(query=True))[REGISTER.MODE] == MODE.POSITION
    assert host.state()[REGISTER.MODE] == MODE.STOPPED
    host.wait(50)
    assert host.current_a == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("said_s", "expected_ms"), [(0.3, 300), (0.0, 100), (math.nan, None)])
def test_its_watchdog(host: Host, said_s: float, expected_ms: int | None) -> None:
    host.torque(0.05, 60, watchdog_timeout=said_s)
    host.wait((expected_ms or 2000) - 15)
    assert host.state()[REGISTER.MODE] == MODE.POSITION
    host.wait(10)
    assert host.state()[REGISTER.MODE] == (MODE.POSITION if expected_ms is None else MODE.TIMEOUT)
    if expected_ms is not None:
        host.wait(20)
        assert host.current_a == pytest.approx(0.0, abs=1e-4)
        host.torque(0.1, 50)
        assert host.state()[REGISTER.MODE] == MODE.TIMEOUT  # only a stop helps
        host.state(CONTROLLER.make_stop(query=True))
        host.torque(0.1, 50)
        assert host.state()[REGISTER.MODE] == MODE.POSITION


def test_questions_do_not_feed_its_watchdog(host: Host) -> None:
    host.torque(0.05, 60, watchdog_timeout=0.2)
    for _ in range(25):
        told = host.state()
        host.wait(9)
    assert told[REGISTER.MODE] == MODE.TIMEOUT


@pytest.mark.parametrize("fault", [(DriveFault.FAULT, 33), (DriveFault.UNDERVOLTAGE, 40),
                                   (DriveFault.OVER_TEMPERATURE, 38)])  # fmt: skip
def test_a_fault_ends_the_current_until_it_is_stopped(host: Host, fault: tuple[DriveFault, int]) -> None:
    host.torque(0.1, 60)
    host.firmware.break_down(fault[0])
    host.torque(0.1, 20)
    told = host.state()
    assert (told[REGISTER.MODE], told[REGISTER.FAULT]) == (MODE.FAULT, fault[1])
    assert host.current_a == pytest.approx(0.0, abs=1e-4)
    host.state(CONTROLLER.make_stop(query=True))
    assert host.state()[REGISTER.FAULT] == 0


def test_it_gets_too_hot(host: Host) -> None:
    host.torque(0.0, 60)
    host.firmware.heating.temperature_c = 101.0
    host.torque(0.0, 10)
    assert host.state()[REGISTER.FAULT] == 38


@pytest.mark.parametrize("mode", [MODE.BRAKE, MODE.ZERO_VELOCITY])
def test_without_a_torque(host: Host, mode: int) -> None:
    host.torque(0.1, 60)
    host.send(bytes((0x01, 0x00, mode)), identifier=0x0001)
    host.wait(20)
    assert host.state()[REGISTER.MODE] == mode
    assert host.current_a == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        ("05010500", "300102"),  # the position: int16
        ("017705", "307701"),  # nobody knows register 0x77
        ("010063", "300003"),  # there is no mode 99
    ],
)
def test_what_cannot_be_written_is_told(host: Host, sent: str, answered: str) -> None:
    """mjlib, micro_server.cc: 1 unknown, 2 not to be written; moteus_controller.cc: 3 no mode."""
    reply = host.ask(bytes.fromhex(sent) + b"\x11\x00")
    assert bytes(reply.data) == bytes.fromhex(answered) + b"\x21\x00\x00"


def test_a_register_that_it_has_not_ends_the_frame(host: Host) -> None:
    reply = host.ask(bytes.fromhex("1170") + CONTROLLER.make_query().data)
    assert bytes(reply.data) == bytes.fromhex("317001")


RESOLUTIONS = {"int8": (moteus.INT8, 0.01), "int16": (moteus.INT16, 1e-4), "int32": (moteus.INT32, 1e-5)}


@pytest.mark.parametrize("name", RESOLUTIONS)
def test_positions_have_the_resolution_that_was_asked_for(host: Host, name: str) -> None:
    resolution, step = RESOLUTIONS[name]
    host.torque(0.1, 80)
    asked = moteus.QueryResolution()
    asked.position = resolution
    host.firmware.freeze()
    exact = host.state()[REGISTER.POSITION]
    coarse = host.state(CONTROLLER.make_query(asked))[REGISTER.POSITION]
    largest = {moteus.INT8: 1.27, moteus.INT16: 3.2767}.get(resolution, math.inf)
    assert coarse == pytest.approx(min(math.trunc(exact / step) * step, largest), abs=1e-9)
    assert abs(exact) > 2 * step


@given(st.binary(max_size=64), st.booleans())
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_no_frame_upsets_it(host: Host, data: bytes, asks: bool) -> None:
    host.send(data, identifier=0x8001 if asks else 0x0001)
    host.wait(2)
    assert math.isfinite(host.current_a)


# ---- as a servo ----------------------------------------------------------------------------------------------------

KP, KD = 2.0, 0.02
SERVO = {"mode": "position", "stiffness": KP, "damping": KD, "loop_period": 125e-6, "velocity_window": 500e-6}


def goal(position_rad: float, **more: float) -> bytes:
    made = CONTROLLER.make_position(position=position_rad / math.tau, velocity_limit=-1.0, accel_limit=-1.0, **more)
    return bytes(made.data)


def hold(host: Host, position_rad: float, ms: int, **more: float) -> None:
    for _ in range(ms // 10):
        host.send(goal(position_rad, **more), identifier=0x0001)
        host.wait(10)


def test_a_jammed_shaft_feels_the_stiffness(open_host: OpenHost) -> None:
    host = open_host(**SERVO)
    host.plant.jam("actuator")
    hold(host, 0.1, 60)
    assert host.current_a == pytest.approx(KP * 0.1 * AMPERES_PER_NM, rel=0.01)
    hold(host, 0.1, 60, kp_scale=0.5)
    assert host.current_a == pytest.approx(0.5 * KP * 0.1 * AMPERES_PER_NM, rel=0.01)


def test_a_free_shaft_goes_to_its_goal_and_is_damped_after_a_timeout(open_host: OpenHost) -> None:
    host = open_host(**SERVO)
    hold(host, 0.0, 60)
    for step in range(20):
        hold(host, 0.025 * (step + 1), 20)
    hold(host, 0.5, 300)
    # Both machines' friction, over the stiffness of the loop.
    assert host.plant.true_position_rad("actuator") == pytest.approx(0.5, abs=(0.02 + 0.008) / (0.05 * 18 * KP))
    host.wait(150)
    assert host.state()[REGISTER.MODE] == MODE.TIMEOUT
    assert abs(host.current_a) < 0.05


TURNS = {"mode": "velocity", "damping": 0.05, "loop_period": 125e-6, "velocity_window": 500e-6}


def turn(host: Host, velocity_rad_s: float, ms: int) -> None:
    """As the driver asks: no position, no kp, no trajectory."""
    made = CONTROLLER.make_position(
        position=math.nan, velocity=velocity_rad_s / math.tau, kp_scale=0.0, velocity_limit=-1.0, accel_limit=-1.0
    )
    for _ in range(ms // 10):
        host.send(bytes(made.data), identifier=0x0001)
        host.wait(10)


def test_told_a_velocity_a_jammed_shaft_feels_the_gain(open_host: OpenHost) -> None:
    host = open_host(**TURNS)
    host.plant.jam("actuator")
    turn(host, 4.0, 60)
    assert host.current_a == pytest.approx(0.05 * 4.0 * AMPERES_PER_NM, rel=0.01)


def test_told_a_velocity_a_free_shaft_turns(open_host: OpenHost) -> None:
    host = open_host(**TURNS)
    turn(host, 6.0, 500)
    start_rad = host.plant.true_position_rad("actuator")
    turn(host, 6.0, 500)
    found_rad_s = (host.plant.true_position_rad("actuator") - start_rad) / 0.5
    # Both machines' friction and damping, and the loop's: K·(c − ω) = τc + B·ω.
    gain = 0.05 * AMPERES_PER_NM * 0.05
    assert found_rad_s == pytest.approx((gain * 6.0 - 0.028) / (gain + 1.3e-3), rel=0.005)


def test_the_output_can_be_set(open_host: OpenHost) -> None:
    host = open_host(**SERVO)
    host.send(CONTROLLER.make_set_output_exact(position=2.0).data, identifier=0x0001)
    host.wait(1)
    assert host.state()[REGISTER.POSITION] == pytest.approx(2.0, abs=1e-4)
