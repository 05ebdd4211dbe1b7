"""The emulated CiA 402 drive, held against python-canopen's tables, and met by python-canopen's own master."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import tau
from os import getpid
from struct import pack, unpack
from typing import Any

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402, State402
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from norton_drivers.canopen.node import SHIPPED
from norton_drivers.codecs.canopen import NmtCommand
from norton_drivers.codecs.cia402 import State
from norton_drivers.wiring import CanBusSettings, DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.cia402 import Cia402Drive
from norton_sim.firmware.context import DriveFault
from norton_sim.serve import serve
from tests.sim_backend.canopen_host import AbortedError, CanopenHost

NODE, MASTER = 5, 0x7F
TORQUE_UNIT_NM = 1e-3
KA = 18.0  # A/(N m)
CST, PROFILE = 10, 4
OFF, SHUTDOWN, ON, ENABLE, QUICK_STOP, RESET = 0x00, 0x06, 0x07, 0x0F, 0x02, 0x80
EMERGENCY, HEARTBEAT, STATUS, MOTION, COMMAND = 0x80 + NODE, 0x700 + NODE, 0x180 + NODE, 0x280 + NODE, 0x200 + NODE
NO_OBJECT, NO_SUBINDEX, READ_ONLY, WRONG_LENGTH = 0x06020000, 0x06090011, 0x06010002, 0x06070010
NOT_MAPPABLE, TOO_LONG, DEVICE_STATE, VALUE = 0x06040041, 0x06040042, 0x08000022, 0x06090030
UNKNOWN_COMMAND, TOGGLE = 0x05040001, 0x05030000

Harm = Callable[["Host"], object]


class Host(CanopenHost):
    """Speaks to the actuator's drive; process data as the bench's driver maps them, but on SYNC."""

    firmware: Cia402Drive

    def set_up(self, command: int = 255, status: int = 1) -> None:
        self.order(NmtCommand.PRE_OPERATIONAL)
        self.map(0x1400, [0x60400010, 0x60600008, 0x60710010], command)
        self.map(0x1800, [0x60410010, 0x60610008, 0x60770010, 0x60780010], status)
        self.map(0x1801, [0x60640020, 0x606C0020], 1)
        self.order(NmtCommand.START)

    def command(self, controlword: int, torque: int = 0, mode: int = CST, wait_ms: float = 1.0) -> None:
        self.send(COMMAND, pack("<Hbh", controlword, mode, torque))
        self.wait(wait_ms)

    def enable(self, mode: int = CST) -> None:
        for controlword in (SHUTDOWN, ON, ENABLE):
            self.command(controlword, mode=mode)
        assert self.firmware.state is State.OPERATION_ENABLED

    def sync(self) -> None:
        self.send(0x80)
        self.wait(1)

    def status(self) -> tuple[int, ...]:
        self.frames(STATUS)
        self.sync()
        return unpack("<Hbhh", self.frames(STATUS)[-1])

    def motion(self) -> tuple[int, ...]:
        self.frames(MOTION)
        self.sync()
        return unpack("<ii", self.frames(MOTION)[-1])

    def beat(self) -> None:
        self.send(0x700 + MASTER, b"\x05")

    def watch(self, timeout_ms: int) -> None:
        self.write(0x1016, 1, "<I", MASTER << 16 | timeout_ms)

    def current_a(self) -> float:
        return self.world.plant.true_current_a("actuator")

    def emergencies(self) -> list[int]:
        return [int.from_bytes(data[:2], "little") for data in self.frames(EMERGENCY)]


@pytest.fixture
def cia402_wiring(wiring: Wiring) -> Wiring:
    options = {
        "node": NODE,
        "torque_per_unit": TORQUE_UNIT_NM,
        "counts_per_turn": 131072,
        "velocity_per_unit": 1e-3,
        "current_per_unit": 0.01,
    }
    return replace(wiring, actuator=DeviceSettings("actuator", "cia402", bus="can0", options=options))


@pytest.fixture
def host(cia402_wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> Host:
    return Host(open_bench(cia402_wiring), cia402_wiring, "actuator", NODE)


@pytest.fixture
def ready(host: Host) -> Host:
    host.set_up()
    return host


def aborted(action: Callable[[], object]) -> int:
    with pytest.raises(AbortedError) as info:
        action()
    return info.value.code


# ---- Parameters -----------------------------------------------------------------------------------------------------


def test_it_says_who_it_is(host: Host) -> None:
    assert host.read(0x1000, 0, "<I") & 0xFFFF == 402
    assert host.text(0x1008) == "simulated servo drive"
    assert host.text(0x1009) == "sim"
    assert host.read(0x6502, 0, "<I") == 0x208
    assert host.read(0x6076, 0, "<I") == 1000  # mN*m: a thousand of its units


@pytest.mark.parametrize(
    ("access", "code"),
    [
        (lambda host: host.read(0x2000, 0, "<I"), NO_OBJECT),
        (lambda host: host.read(0x1018, 9, "<I"), NO_SUBINDEX),
        (lambda host: host.write(0x6041, 0, "<H", 1), READ_ONLY),
        (lambda host: host.write(0x6060, 0, "<H", 1), WRONG_LENGTH),
        (lambda host: host.write(0x6060, 0, "<b", 8), VALUE),
        (lambda host: host.write(0x605E, 0, "<h", 2), VALUE),
        (lambda host: host.write(0x60C2, 2, "<b", -4), VALUE),
        (lambda host: host.write(0x1800, 2, "<B", 245), VALUE),
    ],
)
def test_what_it_refuses(host: Host, access: Harm, code: int) -> None:
    assert aborted(lambda: access(host)) == code


def test_a_text_is_read_in_segments_with_a_toggle(host: Host) -> None:
    host.ask(bytes.fromhex("4008100000000000"))
    assert host.ask(bytes.fromhex("7000000000000000")).code == TOGGLE
    assert host.ask(bytes.fromhex("6000000000000000")).code == UNKNOWN_COMMAND  # it was given up
    assert host.ask(bytes.fromhex("2108100016000000")).code == UNKNOWN_COMMAND  # long values are not written


# ---- Process data ---------------------------------------------------------------------------------------------------


def test_any_mapping_is_honoured(host: Host) -> None:
    host.map(0x1802, [0x60640020, 0x60610008, 0x60410010], 1)
    host.order(NmtCommand.START)
    host.sync()
    position, mode, statusword = unpack("<ibH", host.frames(0x380 + NODE)[0])
    assert (position, mode, statusword & 0x6F) == (0, 0, 0x40)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda host: host.write(0x1A00, 0, "<B", 0), DEVICE_STATE),  # while it is switched on
        (lambda host: host.map(0x1800, [0x60760020], 1), NOT_MAPPABLE),
        (lambda host: host.map(0x1800, [0x60410020], 1), NOT_MAPPABLE),  # a statusword has 16 bits
        (lambda host: host.map(0x1800, [0x60640020, 0x606C0020, 0x60410010], 1), TOO_LONG),
        (lambda host: (host.order(NmtCommand.START), host.write(0x1800, 1, "<I", 0x80000185)), DEVICE_STATE),
    ],
)
def test_mappings_that_cannot_be(host: Host, change: Harm, code: int) -> None:
    assert aborted(lambda: change(host)) == code


def test_a_mapping_cannot_be_changed_entry_by_entry_while_it_counts(host: Host) -> None:
    host.write(0x1800, 1, "<I", 0x80000185)
    assert aborted(lambda: host.write(0x1A00, 1, "<I", 0x60640020)) == DEVICE_STATE


def test_only_an_operational_node_exchanges_process_data(host: Host) -> None:
    host.set_up()
    host.order(NmtCommand.PRE_OPERATIONAL)
    host.sync()
    host.command(SHUTDOWN)
    assert host.frames(STATUS) == []
    assert host.firmware.state is State.SWITCH_ON_DISABLED
    host.order(NmtCommand.START)
    host.command(SHUTDOWN)
    assert host.firmware.state is State.READY


def test_every_so_many_syncs(host: Host) -> None:
    host.set_up(status=4)
    for _ in range(12):
        host.sync()
    assert (len(host.frames(STATUS)), len(host.frames(MOTION))) == (3, 12)


def test_its_own_timer(host: Host) -> None:
    host.map(0x1801, [0x60640020, 0x606C0020], 255, timer_ms=2)
    host.order(NmtCommand.START)
    host.frames(MOTION)
    host.wait(1000)
    assert len(host.frames(MOTION)) == pytest.approx(500, abs=1)


def test_a_statusword_comes_by_itself_where_it_changes(host: Host) -> None:
    host.set_up(status=255)
    host.frames(STATUS)
    host.wait(100)
    assert host.frames(STATUS) == []
    host.command(SHUTDOWN)
    assert len(host.frames(STATUS)) == 1


def test_commands_may_wait_for_sync(host: Host) -> None:
    host.set_up(command=1)
    host.command(SHUTDOWN, wait_ms=20)
    assert host.firmware.state is State.SWITCH_ON_DISABLED
    host.sync()
    assert host.firmware.state is State.READY


def test_a_command_that_is_too_short_is_reported(ready: Host) -> None:
    ready.send(COMMAND, b"\x06\x00")
    ready.wait(1)
    assert ready.firmware.state is State.SWITCH_ON_DISABLED
    assert ready.emergencies() == [0x8210]


# ---- States ---------------------------------------------------------------------------------------------------------


AUTOMATIC = {"START", "NOT READY TO SWITCH ON", "FAULT REACTION ACTIVE"}
WAY_TO: dict[str, tuple[int, ...]] = {
    "SWITCH ON DISABLED": (),
    "READY TO SWITCH ON": (SHUTDOWN,),
    "SWITCHED ON": (SHUTDOWN, ON),
    "OPERATION ENABLED": (SHUTDOWN, ON, ENABLE),
    "QUICK STOP ACTIVE": (SHUTDOWN, ON, ENABLE, QUICK_STOP),
}


@pytest.mark.parametrize(
    ("before", "after", "controlword"),
    [(*states, word) for states, word in State402.TRANSITIONTABLE.items() if states[0] in WAY_TO],
)
def test_every_transition_of_python_canopens_table(ready: Host, before: str, after: str, controlword: int) -> None:
    ready.order(NmtCommand.PRE_OPERATIONAL)
    ready.write(0x605A, 0, "<h", 6)  # stay in a quick stop
    ready.order(NmtCommand.START)
    for step in WAY_TO[before]:
        ready.command(step)
    assert ready.firmware.state.value.upper() == before
    ready.command(controlword)
    assert ready.firmware.state.value.upper() == after
    mask, bits = State402.SW_MASK[after]
    assert ready.status()[0] & mask == bits


@pytest.mark.parametrize("controlword", [ON, ENABLE, QUICK_STOP, OFF, RESET])
def test_no_state_is_skipped(ready: Host, controlword: int) -> None:
    ready.command(controlword)
    assert ready.firmware.state is State.SWITCH_ON_DISABLED


def test_a_quick_stop_gives_no_torque_and_ends_by_itself(ready: Host) -> None:
    ready.enable()
    ready.command(ENABLE, 100, wait_ms=20)
    ready.command(QUICK_STOP, 100, wait_ms=5)
    assert ready.firmware.state is State.QUICK_STOP
    assert ready.firmware.armed
    ready.wait(20)
    assert ready.firmware.state is State.SWITCH_ON_DISABLED
    assert abs(ready.current_a()) < 1e-6


# ---- Torque ---------------------------------------------------------------------------------------------------------


def test_torque_in_units_of_its_own(ready: Host) -> None:
    ready.command(SHUTDOWN, 500)
    ready.wait(20)
    assert ready.current_a() == 0
    ready.enable()
    ready.command(ENABLE, 100, wait_ms=30)
    assert ready.current_a() == pytest.approx(100 * TORQUE_UNIT_NM * KA, rel=1e-3)
    _, mode, torque, current = ready.status()
    assert (mode, torque) == (CST, pytest.approx(100, abs=2))
    assert current == pytest.approx(180, abs=3)  # 10 mA a unit


def test_its_torque_limit(ready: Host) -> None:
    ready.write(0x6072, 0, "<H", 50)
    ready.enable()
    for torque, obeyed in ((400, 50), (-400, -50), (20, 20)):
        ready.command(ENABLE, torque, wait_ms=30)
        assert ready.current_a() == pytest.approx(obeyed * TORQUE_UNIT_NM * KA, rel=1e-3)


def test_a_profile_torque_rises_at_its_slope(ready: Host) -> None:
    ready.write(0x6087, 0, "<I", 1000)
    ready.enable(PROFILE)
    ready.command(ENABLE, 200, PROFILE, wait_ms=100)
    assert ready.current_a() == pytest.approx(0.1 * KA, rel=0.05)
    ready.wait(150)
    assert ready.current_a() == pytest.approx(0.2 * KA, rel=1e-3)


def test_counts_and_velocity(ready: Host) -> None:
    ready.enable()
    ready.command(ENABLE, 100, wait_ms=100)
    plant = ready.world.plant
    position, velocity = ready.motion()
    assert position / 131072 * tau == pytest.approx(plant.true_position_rad("actuator"), rel=0.1)
    assert velocity * 1e-3 == pytest.approx(plant.true_velocity_rad_s("actuator"), rel=0.1)


def test_frozen_values_keep_coming(ready: Host) -> None:
    ready.enable()
    ready.command(ENABLE, 100, wait_ms=100)
    ready.firmware.freeze()
    motions = {ready.motion() for _ in range(20)}
    assert len(motions) == 1
    assert motions.pop()[1] > 0


# ---- Network management ---------------------------------------------------------------------------------------------


def test_its_heartbeat_says_its_state(host: Host) -> None:
    host.write(0x1017, 0, "<H", 10)
    host.wait(1000)
    assert len(beats := host.frames(HEARTBEAT)) == pytest.approx(100, abs=1)
    assert set(beats) == {b"\x7f"}
    for command, state in ((NmtCommand.START, b"\5"), (NmtCommand.STOP, b"\4"), (NmtCommand.PRE_OPERATIONAL, b"\x7f")):
        host.order(command, 1)
        host.frames(HEARTBEAT)
        host.wait(50)
        assert set(host.frames(HEARTBEAT)) == {state}


def test_a_stopped_node_answers_nothing(host: Host) -> None:
    host.order(NmtCommand.STOP)
    host.send(0x600 + NODE, bytes.fromhex("4000100000000000"))
    host.wait(10)
    assert host.frames(0x580 + NODE) == []


@pytest.mark.parametrize("command", [NmtCommand.RESET, NmtCommand.RESET_COMMUNICATION])
def test_a_reset_forgets_communication_and_boots_up(ready: Host, command: NmtCommand) -> None:
    ready.write(0x1017, 0, "<H", 10)
    ready.write(0x6087, 0, "<I", 77)
    ready.order(command, 5)
    ready.frames(HEARTBEAT)
    ready.wait(100)
    assert ready.frames(HEARTBEAT) == [b"\0"]
    assert ready.read(0x1017, 0, "<H") == 0
    assert ready.read(0x1A01, 2, "<I") == 0x60640020  # the mapping at power-on
    assert ready.read(0x6087, 0, "<I") == 77


def test_orders_to_others_are_not_obeyed(host: Host) -> None:
    host.send(0, bytes([1, NODE + 1]))
    host.wait(1)
    assert not host.firmware.node.operational
    host.send(0, bytes([1, 0]))  # to all
    host.wait(1)
    assert host.firmware.node.operational


def test_a_restart_disarms_it_and_counts_from_zero(ready: Host) -> None:
    ready.enable()
    ready.command(ENABLE, 100, wait_ms=200)
    assert ready.motion()[0] > 1000
    ready.firmware.node.restart()
    ready.wait(200)
    assert not ready.firmware.armed
    assert ready.frames(HEARTBEAT) == [b"\0"]
    ready.world.plant.command("actuator", 0.0)
    ready.set_up()
    moved = round(ready.world.plant.true_position_rad("actuator") / tau * 131072)
    assert ready.motion()[0] < moved - 1000


# ---- Watching the host ----------------------------------------------------------------------------------------------


def test_it_watches_from_the_first_heartbeat_on(ready: Host) -> None:
    ready.watch(50)
    ready.enable()
    ready.wait(500)
    assert ready.firmware.armed
    for _ in range(10):
        ready.beat()
        ready.wait(48)
        assert ready.firmware.armed
    ready.wait(1.5)
    assert ready.firmware.armed
    ready.wait(2)
    assert ready.firmware.state is State.FAULT
    assert abs(ready.current_a()) < 1e-6
    assert ready.frames(EMERGENCY) == [bytes.fromhex("3081110000000000")]
    assert ready.read(0x603F, 0, "<H") == 0x8130


@pytest.mark.parametrize(
    ("option", "state"),
    [(0, State.OPERATION_ENABLED), (1, State.FAULT), (2, State.SWITCH_ON_DISABLED), (3, State.QUICK_STOP)],
)
def test_what_it_does_then(ready: Host, option: int, state: State) -> None:
    ready.write(0x6007, 0, "<h", option)
    ready.watch(50)
    ready.enable()
    ready.beat()
    ready.wait(54)
    assert ready.firmware.state is state


@pytest.mark.parametrize(("behaviour", "beats"), [(0, b"\x7f"), (1, b"\5"), (2, b"\4")])
def test_whether_it_leaves_operation(ready: Host, behaviour: int, beats: bytes) -> None:
    ready.write(0x1029, 1, "<B", behaviour)
    ready.watch(50)
    ready.beat()
    ready.wait(60)
    ready.firmware.node._send_heartbeat()
    ready.wait(1)
    assert ready.frames(HEARTBEAT) == [beats]


def test_a_watch_that_was_ended_is_no_watch(ready: Host) -> None:
    ready.watch(50)
    ready.enable()
    ready.beat()
    ready.wait(10)
    ready.write(0x1016, 1, "<I", 0)
    ready.wait(500)
    assert ready.firmware.armed


def test_other_heartbeats_do_not_feed_it(ready: Host) -> None:
    ready.watch(50)
    ready.enable()
    ready.beat()
    for _ in range(6):
        ready.send(0x700 + MASTER - 1, b"\5")
        ready.wait(10)
    assert not ready.firmware.armed


def test_a_lost_host_is_forgotten_only_after_a_reset_of_communication(ready: Host) -> None:
    ready.watch(50)
    ready.enable()
    ready.beat()
    ready.wait(60)
    ready.order(NmtCommand.START)
    for _ in range(2):
        ready.command(OFF)
        ready.command(RESET)
    assert ready.firmware.state is State.FAULT
    ready.order(NmtCommand.RESET_COMMUNICATION, 50)
    ready.set_up()
    ready.command(OFF)
    ready.command(RESET)
    assert ready.firmware.state is State.SWITCH_ON_DISABLED
    assert ready.emergencies() == [0x8130, 0]


def test_told_to_stop_communicating_it_stops(ready: Host) -> None:
    ready.enable()
    ready.order(NmtCommand.STOP)
    assert not ready.firmware.armed


# ---- Faults ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "code"),
    [(DriveFault.FAULT, 0x2310), (DriveFault.UNDERVOLTAGE, 0x3220), (DriveFault.OVER_TEMPERATURE, 0x4310)],
)
def test_a_fault_disarms_it_until_a_rising_edge(ready: Host, fault: DriveFault, code: int) -> None:
    ready.enable()
    ready.command(ENABLE, 100, wait_ms=20)
    ready.firmware.break_down(fault)
    ready.command(ENABLE, 100, wait_ms=20)
    assert not ready.firmware.armed
    assert abs(ready.current_a()) < 1e-6
    assert (ready.emergencies(), ready.read(0x603F, 0, "<H")) == ([code], code)
    ready.command(RESET)
    assert (ready.firmware.state, ready.emergencies()) == (State.SWITCH_ON_DISABLED, [0])
    assert ready.read(0x603F, 0, "<H") == 0


def test_a_bit_that_stays_high_resets_nothing(ready: Host) -> None:
    ready.command(RESET)
    ready.firmware.break_down(DriveFault.FAULT)
    for _ in range(5):
        ready.command(RESET)
    assert ready.firmware.state is State.FAULT


def test_too_hot_it_stays_in_fault(ready: Host) -> None:
    ready.enable()
    ready.firmware.heating.temperature_c = 120.0
    ready.wait(20)
    assert ready.emergencies() == [0x4310]
    for controlword in (OFF, RESET, OFF):
        ready.command(controlword)
    assert ready.firmware.state is State.FAULT
    ready.firmware.heating.temperature_c = 30.0
    ready.command(RESET)
    assert ready.firmware.state is State.SWITCH_ON_DISABLED


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300)
@given(
    identifier=st.sampled_from([0x000, 0x080, COMMAND, 0x300 + NODE, 0x600 + NODE, 0x700 + MASTER, EMERGENCY]),
    data=st.binary(max_size=8),
    remote=st.booleans(),
)
def test_no_frame_makes_it_stumble(ready: Host, identifier: int, data: bytes, remote: bool) -> None:
    ready.send(identifier, b"" if remote else data, is_remote_frame=remote)
    ready.wait(1)
    assert ready.firmware.state in State


# ---- A master that nobody here wrote --------------------------------------------------------------------------------


@contextmanager
def served(wiring: Wiring, simulated: dict[str, Any]) -> Iterator[None]:
    """In wall time, on the rig's bus."""
    ready, done = threading.Event(), threading.Event()
    arguments = {"seed": 1, "place": "rig.toml", "on_ready": ready.set, "stop": done.is_set}
    thread = threading.Thread(target=serve, args=(wiring, simulated), kwargs=arguments)
    thread.start()
    try:
        assert ready.wait(20)
        yield
    finally:
        done.set()
        thread.join()


@pytest.mark.wall_time
def test_python_canopens_own_master_drives_it(cia402_wiring: Wiring, simulated: dict[str, Any]) -> None:
    channel = f"BaseNode402 {getpid()}"
    wiring = replace(cia402_wiring, buses=(CanBusSettings("can0", "virtual", channel),), load=None, torque_sensor=None)
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    with served(wiring, simulated):
        network.connect(interface="virtual", channel=channel)
        try:
            drive_with(network)
        finally:
            network.sync.stop()
            network.disconnect()


def drive_with(network: canopen.Network) -> None:
    node = BaseNode402(NODE, str(SHIPPED / "cia402.eds"))
    network.add_node(node)
    assert node.sdo[0x1008].raw == "simulated servo drive"
    node.nmt.state = "PRE-OPERATIONAL"
    set_up_maps(node)
    node.setup_402_state_machine(read_pdos=False)
    node.nmt.state = "OPERATIONAL"
    network.sync.start(0.01)
    node.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    node.state = "OPERATION ENABLED"
    assert node.state == "OPERATION ENABLED"
    torque = node.rpdo[1]
    torque["Target torque"].raw = 50
    torque.transmit()
    assert node.tpdo[1].wait_for_reception(1) is not None
    assert node.tpdo[1].wait_for_reception(1) is not None
    assert node.tpdo_values[0x6077] == pytest.approx(50, abs=3)
    node.state = "SWITCH ON DISABLED"
    assert node.state == "SWITCH ON DISABLED"


def set_up_maps(node: BaseNode402) -> None:
    node.pdo.read()
    maps = ((node.rpdo[1], ("Controlword", "Modes of operation", "Target torque"), 255),
            (node.tpdo[1], ("Statusword", "Modes of operation display", "Torque actual value"), 1))  # fmt: skip
    for pdo, names, kind in maps:
        pdo.clear()
        for name in names:
            pdo.add_variable(name)
        pdo.trans_type, pdo.enabled = kind, True
        pdo.save()
