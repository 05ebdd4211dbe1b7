"""The CiA 402 driver against a scripted drive: what it sets up, sends and makes of what comes."""

import math
import random
import struct
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from norton_drivers.canopen import node as canopen_node
from norton_drivers.canopen.cia402 import Cia402Drive, open_amplifier
from norton_drivers.codecs.canopen import NmtCommand, NmtState
from norton_drivers.codecs.cia402 import Controlword, State
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.readings import DriveState
from tests.drivers.canopen.canopen_peers import ScriptedDrive

NODE = 5
FRAMES = 100_000
TORQUE_UNIT_NM = 1e-3
COUNTS = 4000
VELOCITY_UNIT_RAD_S = 0.01
SCALES = {"torque_per_unit": TORQUE_UNIT_NM, "counts_per_turn": COUNTS, "velocity_per_unit": VELOCITY_UNIT_RAD_S}
OFF, RESET = Controlword.DISABLE_VOLTAGE, Controlword.FAULT_RESET


@pytest.fixture
def drive(world):
    return ScriptedDrive(world, NODE)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_drive(drive, link, device):
    def opened(direction: int = 1, role: str = "actuator", **options: object) -> Cia402Drive:
        return open_amplifier(device(role, "cia402", direction=direction, **{"node": NODE, **SCALES, **options}), link)

    return opened


def words(drive: ScriptedDrive) -> list[int]:
    """The controlwords that came, each once where it came again and again."""
    changes = [drive.commands[0], *(b for a, b in pairwise(drive.commands) if b.controlword != a.controlword)]
    return [command.controlword for command in changes]


# ---- Setting up -----------------------------------------------------------------------------------------------------


def test_process_data_are_set_up_while_switched_off_and_before_the_start(drive, open_drive):
    open_drive()
    assert drive.orders == [NmtCommand.PRE_OPERATIONAL, NmtCommand.START]
    off = 1 << 31
    mapping = [entry for entry in drive.written if entry[0] in (0x1400, 0x1600)]
    assert mapping == [
        (0x1400, 1, 0x205 | off),
        (0x1400, 2, 255),
        (0x1600, 0, 0),
        (0x1600, 1, 0x60400010),
        (0x1600, 2, 0x60600008),
        (0x1600, 3, 0x60710010),
        (0x1600, 0, 3),
        (0x1400, 1, 0x205),
    ]
    sent = [entry for entry in drive.written if entry[0] in (0x1800, 0x1A00)]
    assert sent == [
        (0x1800, 1, 0x185 | off),
        (0x1800, 2, 255),
        (0x1800, 3, 0),
        (0x1800, 5, 1),
        (0x1A00, 0, 0),
        (0x1A00, 1, 0x60410010),
        (0x1A00, 2, 0x60610008),
        (0x1A00, 3, 0x60770010),
        (0x1A00, 0, 3),
        (0x1800, 1, 0x185),
    ]
    assert (0x1A01, 1, 0x60640020) in drive.written
    assert (0x1A01, 2, 0x606C0020) in drive.written
    # The others are of no use here, and would only fill the bus.
    assert [drive.parameters[index, 1] for index in (0x1802, 0x1803)] == [
        struct.pack("<I", identifier | off) for identifier in (0x385, 0x485)
    ]
    assert drive.parameters[0x1017, 0] == struct.pack("<H", 100)


def test_the_bit_that_forbids_remote_frames_is_left_as_it_is(drive, open_drive):
    drive.parameters[0x1800, 1] = struct.pack("<I", 0x185 | 1 << 30)
    open_drive()
    assert drive.parameters[0x1800, 1] == struct.pack("<I", 0x185 | 1 << 30)
    assert drive.parameters[0x1801, 1] == struct.pack("<I", 0x285)


def test_sync(drive, link, open_drive):
    open_drive(feedback="sync", commands="at sync", period=2e-3, status_every=4)
    assert [drive.parameters[index, 2] for index in (0x1400, 0x1800, 0x1801)] == [b"\1", b"\4", b"\1"]
    drive.sent.clear()
    for _ in range(100):
        link.wait(500_000)  # four polls to a period
    syncs = [frame for frame in drive.sent if frame.arbitration_id == 0x80]
    assert len(syncs) == pytest.approx(25, abs=9)
    assert all(len(frame.data) == 0 for frame in syncs)


def test_a_poll_has_at_most_one_sync_whoever_wants_it(drive, world, link, open_drive):
    open_drive(feedback="sync")
    drive.sent.clear()
    for _ in range(50):
        link.wait()
    assert [frame.arbitration_id for frame in drive.sent] == [0x80] * 50


def test_a_bench_that_reads_ahead_sends_no_sync(drive, link, open_drive):
    open_drive(feedback="sync")
    drive.sent.clear()
    for _ in range(50):
        link.wait(800_000)
        link.clock.wait_until_ns(link.clock.now_ns() + 200_000)
        link.read_ahead()
    assert [frame.arbitration_id for frame in drive.sent] == [0x80] * 50


def test_the_interpolation_period_is_that_of_the_commands(drive, open_drive):
    open_drive(period=4e-3)
    assert [drive.parameters[0x60C2, sub] for sub in (2, 1)] == [b"\xfd", b"\4"]


def test_profile_torque(drive, open_drive):
    amplifier = open_drive(mode="profile torque", torque_slope=50.0)
    assert drive.parameters[0x6087, 0] == struct.pack("<I", 50_000)
    amplifier.enable()
    assert {command.mode for command in drive.commands} == {4}


def test_current_is_read_where_it_has_a_scale(drive, link, open_drive):
    amplifier = open_drive(-1, current_per_unit=0.02)
    assert drive.parameters[0x1A00, 4] == struct.pack("<I", 0x60780010)
    drive.current = -150
    link.poll()
    amplifier.take_current()
    drive.report()
    link.poll()
    (reading,) = amplifier.take_current()
    assert reading.current_a == pytest.approx(3.0)


def test_without_a_scale_there_is_no_current(drive, link, open_drive):
    amplifier = open_drive()
    drive.report()
    link.poll()
    assert amplifier.take_current() == []


def test_parameters_that_a_drive_does_not_have_are_done_without(drive, open_drive):
    for missing in ((0x60C2, 1), (0x60C2, 2), (0x1802, 1), (0x1803, 1), (0x6502, 0), (0x6007, 0), (0x1018, 2)):
        del drive.parameters[missing]
    drive.texts.clear()
    amplifier = open_drive()
    amplifier.enable()
    assert amplifier.identify().hardware == "vendor 0x2B1 product 0x0"


@pytest.mark.parametrize(
    ("harm", "sentence"),
    [
        (lambda drive: setattr(drive, "deaf", True), r"\[actuator\] CANopen node 5 on can0: does not answer for "
         r"parameter 1000h:0 \(no answer\); is it powered and on this bus"),
        (lambda drive: drive.parameters.update({(0x1000, 0): struct.pack("<I", 0x194)}),
         "follows profile 404, not 402"),
        (lambda drive: drive.aborts.update({(0x1A01, 2): 0x06040041}),
         r"refuses parameter 1A01h:2 = 1617690656 \(0x606C0020\): Code 0x06040041, Object cannot be mapped"),
        (lambda drive: drive.parameters.update({(0x1000, 0): b"\1"}), "1000h:0 is not what its EDS file says"),
    ],
)  # fmt: skip
def test_what_a_drive_cannot_be_set_up_with(drive, open_drive, harm, sentence):
    harm(drive)
    with pytest.raises(DeviceError, match=sentence):
        open_drive()


def test_a_drive_that_does_not_start(drive, open_drive):
    drive.orders = type("Deaf", (list,), {"append": lambda self, order: setattr(drive, "state", drive.state)})()
    drive.obey = lambda order: None
    with pytest.raises(DeviceTimeoutError, match=r"told to start, but stays pre-operational \(2\.3 s waited\)"):
        open_drive()


def test_a_lost_frame_is_asked_for_again(drive, open_drive):
    """Were only one lost, an adapter that loses one now and then would make every set-up fail."""
    answer, asked = drive.answer, []

    def losing(request):
        asked.append(request)
        if len(asked) % 7 != 1:
            answer(request)

    drive.answer = losing
    amplifier = open_drive()
    drive.answer = answer
    assert amplifier.identify().firmware == "7.1"


# ---- Who it is ------------------------------------------------------------------------------------------------------


def test_identity(drive, open_drive):
    identity = open_drive().identify()
    assert (identity.driver, identity.address) == ("cia402", "can0 node 5")
    assert (identity.hardware, identity.firmware) == ("a device's long name", "7.1")


def test_a_mode_that_it_does_not_have(drive, open_drive):
    drive.parameters[0x6502, 0] = struct.pack("<I", 0x08)
    with pytest.raises(DeviceError, match=r'does not have mode = "cyclic synchronous torque" \(6502h says 0x8\)'):
        open_drive().identify()


def test_two_devices_with_one_node_id(drive, open_drive):
    amplifier = open_drive()
    drive.twin = True
    with pytest.raises(DeviceError, match=r"two devices (answer to|with) this node id"):
        amplifier.identify()


@pytest.mark.parametrize(
    ("mute", "sentence"),
    [
        ("mute_status", r"no statusword \(TPDO1\) as it was"),
        ("mute_motion", r"no position and velocity \(TPDO2\)"),
    ],
)
def test_silent_process_data(drive, open_drive, mute, sentence):
    amplifier = open_drive()
    setattr(drive, mute, True)
    with pytest.raises(DeviceTimeoutError, match=sentence):
        amplifier.identify()


def test_an_eds_file_of_another_product(drive, open_drive, tmp_path):
    path = tmp_path / "other.eds"
    path.write_text((canopen_node.SHIPPED / "cia402.eds").read_text().replace("ProductNumber=0", "ProductNumber=0x77"))
    with pytest.raises(DeviceError, match="product number is 0x51, but that of its EDS file is 0x77"):
        open_drive(eds=str(path)).identify()


def test_an_eds_file_that_lacks_what_is_needed(drive, open_drive, tmp_path):
    path = tmp_path / "poor.eds"
    path.write_text((canopen_node.SHIPPED / "cia402.eds").read_text().replace("[6041]", "[2041]"))
    with pytest.raises(DeviceError, match="parameter 6041h:0 is not in its EDS file"):
        open_drive(eds=str(path))


@pytest.mark.parametrize("content", [None, b"\xff\xfe\0", b"no section\n", b"[DeviceInfo]\n[1000]\nParameterName=x\n"])
def test_an_eds_file_that_is_none(drive, open_drive, tmp_path, content):
    path = tmp_path / "broken.eds"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(WiringError, match=r"\[actuator\] eds = .*(neither a file nor|is not an EDS file)"):
        open_drive(eds=str(path))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"node": 0}, r"node = 0: input should be greater than or equal to 1"),
        ({"node": 127}, r"node = 127 is our own \(master_node\)"),
        ({"watchdog": 0.01}, r"watchdog = 0\.01: shorter than a computer"),
        ({"period": 1.5e-3}, r"period = 0\.0015: a drive's timers count whole milliseconds"),
        ({"mode": "position"}, r"mode = 'position'"),
        ({"mode": "profile torque"}, r'torque_slope = None: mode = "profile torque" needs it \(how fast'),
    ],
)
def test_wrong_options(drive, open_drive, options, sentence):
    with pytest.raises(WiringError, match=sentence):
        open_drive(**options)


@pytest.mark.parametrize("scale", SCALES)
def test_scales_are_not_guessed(drive, link, device, scale):
    given = {key: value for key, value in SCALES.items() if key != scale}
    with pytest.raises(WiringError, match=rf'\[actuator\] driver = "cia402" needs {scale}: '):
        open_amplifier(device("actuator", "cia402", node=NODE, **given), link)


def test_two_drivers_on_one_node(drive, open_drive):
    open_drive()
    with pytest.raises(WiringError, match=r"\[load\] identifier 0x705 on can0 belongs to \[actuator\] already"):
        open_drive(role="load")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"master_node": 1}, r"master_node = 1, but another device on can0 has 127"),
        ({"feedback": "sync", "period": 2e-3}, r"wants a SYNC every 2 ms, another device on can0 every 1 ms"),
    ],
)
def test_a_bus_has_one_master_and_one_sync(drive, open_drive, options, sentence):
    open_drive(feedback="sync")
    with pytest.raises(WiringError, match=sentence):
        open_drive(role="load", node=6, **options)


# ---- Enabling -------------------------------------------------------------------------------------------------------


def test_the_way_up(drive, open_drive):
    amplifier = open_drive()
    assert amplifier.status().state is DriveState.IDLE
    amplifier.enable()
    assert words(drive) == [OFF, 0x06, 0x07, 0x0F]
    assert {(command.mode, command.target) for command in drive.commands} == {(10, 0)}
    assert amplifier.status().state is DriveState.ENABLED
    assert amplifier.status().errors == ()


@pytest.mark.parametrize("feedback", ["sync", "timer"])
def test_a_fault_is_reset_by_a_rising_edge(drive, open_drive, feedback):
    amplifier = open_drive(feedback=feedback)
    drive.where, drive.last_controlword = State.FAULT, RESET  # the bit was left high by somebody
    amplifier.enable()
    assert words(drive) == [OFF, RESET, 0x06, 0x07, 0x0F]
    assert drive.resets == 1
    assert amplifier.status().state is DriveState.ENABLED


def test_from_wherever_it_stands(drive, open_drive):
    drive.where = State.OPERATION_ENABLED
    amplifier = open_drive()
    assert amplifier.status().state is DriveState.ENABLED
    amplifier.enable()
    assert words(drive)[0] == OFF
    assert amplifier.status().state is DriveState.ENABLED


@pytest.mark.parametrize(
    ("refused", "told", "stays"),
    [
        (State.READY, "shutdown", "Switch on disabled"),
        (State.SWITCHED_ON, "switch on", "Ready to switch on"),
        (State.OPERATION_ENABLED, "enable operation", "Switched on"),
    ],
)
def test_where_it_is_stuck(drive, open_drive, refused, told, stays):
    amplifier = open_drive()
    drive.refuses = {refused}
    sentence = f'stays in "{stays}" when told to {told}, instead of "{refused.value}"; check its enable input'
    with pytest.raises(DeviceTimeoutError, match=sentence):
        amplifier.enable(timeout_s=0.1)
    assert amplifier.status().state is not DriveState.ENABLED


@pytest.mark.parametrize(
    ("lacking", "hint"),
    [(1 << 9, "takes no commands from the bus"), (1 << 4, "its power stage has no voltage")],
)
def test_why_it_is_stuck(drive, open_drive, lacking, hint):
    amplifier = open_drive()
    drive.refuses = {State.READY}
    drive.statusword_bits &= ~lacking
    with pytest.raises(DeviceTimeoutError, match=hint):
        amplifier.enable(timeout_s=0.1)


def test_a_fault_that_stays(drive, open_drive):
    amplifier = open_drive()
    drive.where, drive.refuses = State.FAULT, {State.SWITCH_ON_DISABLED}
    drive.emergency(0x3220)
    with pytest.raises(DeviceError, match=r'is in "Fault" when told to reset its fault.*: bus voltage too low'):
        amplifier.enable(timeout_s=0.1)


def test_a_fault_on_the_way(drive, open_drive):
    amplifier = open_drive()
    drive.STEPS = {**drive.STEPS, (State.SWITCHED_ON, Controlword.ENABLE_OPERATION): State.FAULT}
    with pytest.raises(DeviceError, match=r'is in "Fault" when told to enable operation.*says no reason'):
        amplifier.enable(timeout_s=0.1)


def test_a_mode_that_it_does_not_take(drive, open_drive):
    amplifier = open_drive()
    drive.mode = 8
    with pytest.raises(DeviceTimeoutError, match=r"does not take mode of operation 10 \(6060h\), and stays in 8"):
        amplifier.enable(timeout_s=0.1)
    assert drive.where is not State.OPERATION_ENABLED


def test_a_drive_that_says_nothing_more(drive, open_drive):
    amplifier = open_drive(watchdog=0.0)
    drive.deaf = True
    with pytest.raises(DeviceTimeoutError, match="sends no statusword"):
        amplifier.enable(timeout_s=0.1)


# ---- The watchdog ---------------------------------------------------------------------------------------------------


def test_the_drive_watches_our_heartbeat(drive, link, open_drive):
    amplifier = open_drive(watchdog=0.3)
    assert drive.beats_ns == []
    amplifier.enable()
    assert drive.parameters[0x1016, 1] == struct.pack("<I", 127 << 16 | 300)
    for _ in range(500):
        amplifier.command(0.0)
        link.wait()
    gaps = [b - a for a, b in pairwise(drive.beats_ns)]
    assert max(gaps) <= 62_000_000


def test_the_heartbeat_stops_with_the_commands(drive, link, open_drive):
    amplifier = open_drive(watchdog=0.1)
    amplifier.enable()
    before = len(drive.beats_ns)
    for _ in range(200):
        link.wait()  # the host is there, and polls; only its loop stands still
    assert len(drive.beats_ns) == before


def test_a_drive_that_is_enabled_has_heard_our_heartbeat(drive, open_drive):
    """Before that it does not watch: a host that died now would leave it enabled."""
    amplifier = open_drive(watchdog=5.0)
    for _ in range(2):
        before = len(drive.beats_ns)
        amplifier.enable()
        enabled_ns = next(ns for ns, c in zip(drive.command_ns, drive.commands, strict=True) if c.controlword == 0x0F)
        assert drive.beats_ns[before] <= enabled_ns
        amplifier.stop()
        drive.commands.clear()
        drive.command_ns.clear()


def test_enabling_feeds_the_watchdog(drive, open_drive):
    drive.refuses = {State.OPERATION_ENABLED}
    amplifier = open_drive(watchdog=0.02)
    with pytest.raises(DeviceTimeoutError):
        amplifier.enable(timeout_s=0.3)
    gaps = [b - a for a, b in pairwise(drive.beats_ns)]
    assert len(gaps) > 50
    assert max(gaps) < 20_000_000


def test_a_drive_that_would_do_nothing_is_told_to_fault(drive, open_drive):
    drive.parameters[0x6007, 0] = bytes(2)
    open_drive().enable()
    assert drive.parameters[0x6007, 0] == b"\1\0"


def test_a_reaction_that_was_chosen_is_left(drive, open_drive):
    drive.parameters[0x6007, 0] = b"\2\0"
    open_drive().enable()
    assert drive.parameters[0x6007, 0] == b"\2\0"


def test_a_watchdog_that_does_not_take_is_refused_before_anything_is_enabled(drive, open_drive):
    drive.stuck = {(0x1016, 1)}
    amplifier = open_drive()
    with pytest.raises(DeviceError, match=r"does not take 0\.1 s \(1016h says 0x00000000 after 0x007F0064"):
        amplifier.enable()
    assert drive.where is State.SWITCH_ON_DISABLED


def test_a_drive_that_cannot_watch(drive, open_drive):
    del drive.parameters[0x1016, 1]
    amplifier = open_drive()
    with pytest.raises(DeviceError, match=r'no parameter 1016h\); give it watchdog = "0 s" only if'):
        amplifier.enable()


def test_no_watchdog_where_the_rig_says_so(drive, open_drive):
    amplifier = open_drive(watchdog=0.0)
    amplifier.enable()
    amplifier.command(0.1)
    assert drive.beats_ns == []
    assert not any(index == 0x1016 for index, _, _ in drive.written)


def test_a_drive_that_makes_itself_safe(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    amplifier.provoke_watchdog()
    link.wait()
    assert amplifier.made_itself_safe() is False
    drive.where = State.FAULT
    link.wait()
    link.wait()
    assert amplifier.made_itself_safe() is True


def test_a_drive_that_leaves_operation_is_asked_whether_it_is_safe(drive, link, open_drive):
    """Its process data end with that, and with them its statusword."""
    amplifier = open_drive()
    amplifier.enable()
    amplifier.provoke_watchdog()
    drive.where, drive.state = State.FAULT, NmtState.PRE_OPERATIONAL
    drive.emergency(0x8130)
    for _ in range(110):
        link.wait()
        amplifier.made_itself_safe()
    assert amplifier.made_itself_safe() is True


def test_leaving_operation_alone_is_not_safe(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    amplifier.provoke_watchdog()
    drive.state = NmtState.PRE_OPERATIONAL
    for _ in range(200):
        link.wait()
        assert amplifier.made_itself_safe() is False


@pytest.mark.parametrize("code", [0x8130, 0x8120])
def test_after_a_lost_bus_communication_is_reset_before_the_fault(drive, link, open_drive, code):
    amplifier = open_drive()
    amplifier.enable()
    drive.where = State.FAULT
    drive.parameters[0x603F, 0] = struct.pack("<H", code)
    drive.emergency(code)
    link.poll()
    drive.orders.clear()
    amplifier.enable()
    assert drive.orders == [NmtCommand.RESET_COMMUNICATION, NmtCommand.PRE_OPERATIONAL, NmtCommand.START]
    assert amplifier.status().state is DriveState.ENABLED
    assert not amplifier.node.restarted  # we had asked for it


def test_the_last_hosts_departure_is_no_fault(drive, open_drive):
    drive.where, drive.parameters[0x603F, 0] = State.FAULT, struct.pack("<H", 0x8130)
    amplifier = open_drive()
    assert amplifier.status().state is DriveState.IDLE


def test_another_fault_is_told_and_not_reset(drive, open_drive):
    drive.where, drive.parameters[0x603F, 0] = State.FAULT, struct.pack("<H", 0x4310)
    amplifier = open_drive()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("drive too hot (0x4310)",)


# ---- Running --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
def test_signs_and_scales(drive, link, open_drive, direction):
    amplifier = open_drive(direction)
    amplifier.enable()
    link.poll()
    amplifier.take_motion()
    drive.position, drive.velocity, drive.torque = COUNTS // 4, -250, 40
    drive.report()
    link.poll()
    reading = amplifier.take_motion()[-1]
    assert reading.position_rad == pytest.approx(direction * math.pi / 2)
    assert reading.velocity_rad_s == pytest.approx(direction * -2.5)
    assert amplifier.actual_torque_nm == pytest.approx(direction * 0.04)
    amplifier.command(0.1234)
    assert drive.commands[-1] == (0x0F, 10, direction * 123)
    assert amplifier.position_resolution_rad == pytest.approx(math.tau / COUNTS)


def test_each_frame_is_one_reading_with_its_arrival(world, drive, link, open_drive):
    amplifier = open_drive()
    link.poll()
    before = len(amplifier.take_motion())
    drive.report()
    drive.report()
    world.clock.ns += 700
    link.poll()
    readings = amplifier.take_motion()
    assert [reading.sequence for reading in readings] == [before, before + 1]
    assert {reading.arrival_ns for reading in readings} == {world.clock.ns}
    assert amplifier.take_motion() == []


@pytest.mark.parametrize(("start", "step"), [(0x7FFFFF00, 0x180), (-0x7FFFFF00, -0x180)])
def test_a_position_that_wraps_goes_on(drive, link, open_drive, start, step):
    amplifier = open_drive()
    link.poll()
    amplifier.take_motion()
    positions = []
    for k in range(3):
        drive.position = (start + k * step + (1 << 31)) % (1 << 32) - (1 << 31)
        drive.report()
        link.poll()
        positions.append(amplifier.take_motion()[-1].position_rad)
    steps = [b - a for a, b in pairwise(positions)]
    assert steps == pytest.approx([step * math.tau / COUNTS] * 2, rel=1e-6)


def test_torque_is_right_on_average_though_the_drive_takes_whole_units(drive, open_drive):
    amplifier = open_drive()
    drive.commands.clear()
    for _ in range(1000):
        amplifier.command(0.0123)
    targets = [command.target for command in drive.commands]
    assert set(targets) == {12, 13}
    assert sum(targets) == pytest.approx(12_300, abs=1)
    amplifier.command(0.0)
    assert drive.commands[-1].target == 0
    amplifier.command(-0.0004)
    assert drive.commands[-1].target == 0  # nothing is left of what was before the zero


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e6, -32.9])
def test_a_torque_that_cannot_be_commanded(drive, open_drive, value):
    amplifier = open_drive()
    before = len(drive.commands)
    with pytest.raises(DeviceError, match=r"cannot command a torque of .*it takes up to 32\.767 N\*m"):
        amplifier.command(value)
    assert len(drive.commands) == before


def test_frames_of_others_and_malformed_ones(world, drive, link, open_drive):
    amplifier = open_drive()
    link.poll()
    amplifier.take_motion()
    statuses = amplifier.statuses
    world.bus.arrive(0x286, bytes(8))
    world.bus.arrive(0x285, bytes(8), extended=True)
    world.bus.arrive(0x285, remote=True)
    link.poll()
    assert (amplifier.take_motion(), amplifier.node.malformed) == ([], 0)
    for identifier, data in ((0x285, bytes(6)), (0x185, bytes(2)), (0x705, b""), (0x85, bytes(3)), (0x585, bytes(4))):
        world.bus.arrive(identifier, data)
    link.poll()
    assert (amplifier.take_motion(), amplifier.statuses, amplifier.node.malformed) == ([], statuses, 5)


def test_a_hundred_thousand_random_frames_give_no_false_reading(world, drive, link, open_drive):
    amplifier = open_drive(current_per_unit=0.01)
    link.poll()
    amplifier.take_motion()
    amplifier.take_current()
    rng, motions, currents = random.Random(7), 0, 0
    identifiers = [0x000, 0x080, 0x085, 0x185, 0x205, 0x285, 0x385, 0x585, 0x605, 0x705, 0x77F, 0x286, 0x184]
    for k in range(FRAMES):
        identifier, data = rng.choice(identifiers), rng.randbytes(rng.randrange(9))
        extended, remote = rng.random() < 0.05, rng.random() < 0.05
        if identifier == 0x705 and data == b"\0":
            continue  # a restart ends all readings, and rightly
        world.bus.arrive(identifier, b"" if remote else data, extended=extended, remote=remote)
        ours = not (extended or remote)
        motions += ours and (identifier, len(data)) == (0x285, 8)
        currents += ours and (identifier, len(data)) == (0x185, 7)
        if k % 1000 == 999:
            link.poll()
            motions -= len(amplifier.take_motion())
            currents -= len(amplifier.take_current())
    assert (motions, currents) == (0, 0)
    assert amplifier.node.malformed > 10_000


def test_a_bus_that_echoes_confuses_nobody(world, drive, link, open_drive):
    """Some adapters hand back what was sent: commands, heartbeats, SYNC, requests and network management."""
    plain = world.bus.peer

    def echo(frame):
        world.bus.arrive(frame.arbitration_id, bytes(frame.data))
        plain(frame)

    world.bus.peer = echo
    amplifier = open_drive(feedback="sync")
    amplifier.identify()
    amplifier.enable()
    for _ in range(300):
        amplifier.command(0.01)
        link.wait()
    assert amplifier.status().state is DriveState.ENABLED
    assert amplifier.node.malformed == 0
    assert not amplifier.node.restarted


# ---- When it goes wrong ---------------------------------------------------------------------------------------------


def test_a_fault_is_told_in_words(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.where = State.FAULT
    drive.emergency(0x2310)
    drive.report()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("continuous over-current in the motor (0x2310)",)
    drive.emergency(0)
    link.poll()
    assert amplifier.status().errors == ('left "Operation enabled" without an error (for "Fault")',)


def test_leaving_operation_enabled_is_a_fault(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.where = State.SWITCH_ON_DISABLED
    drive.report()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ('left "Operation enabled" without an error (for "Switch on disabled")',)


@pytest.mark.parametrize(
    ("left_to", "controlword"),
    [(State.SWITCHED_ON, OFF), (State.READY, OFF), (State.FAULT, OFF), (State.QUICK_STOP, Controlword.QUICK_STOP)],
)
def test_commands_do_not_bring_it_back(drive, link, open_drive, left_to, controlword):
    amplifier = open_drive()
    amplifier.enable()
    drive.where = left_to
    drive.step = lambda controlword: None
    drive.report()
    link.poll()
    amplifier.command(0.1)
    assert drive.commands[-1].controlword == controlword
    drive.where = State.OPERATION_ENABLED  # by whatever hand
    drive.report()
    link.poll()
    amplifier.command(0.1)
    assert drive.commands[-1].controlword == controlword
    assert amplifier.status().state is DriveState.FAULT


def test_a_failed_enabling_leaves_nothing_half_way(drive, open_drive):
    drive.refuses = {State.OPERATION_ENABLED}
    amplifier = open_drive()
    with pytest.raises(DeviceTimeoutError):
        amplifier.enable(timeout_s=0.05)
    drive.refuses = set()
    amplifier.command(0.0)
    assert drive.where is State.SWITCH_ON_DISABLED
    assert drive.commands[-1].controlword == OFF


def test_leaving_the_exchange_of_process_data_is_a_fault(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.state = NmtState.STOPPED
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("left the exchange of process data (now stopped)",)


def test_a_restart_while_running_is_a_fault_and_its_frames_are_no_readings(world, drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.boot_up()
    link.poll()
    amplifier.take_motion()
    world.bus.arrive(0x285, bytes(8))  # of the mapping at power-on, for instance
    link.poll()
    assert amplifier.take_motion() == []
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("it restarted by itself, and has forgotten its settings",)


def test_after_a_restart_everything_is_set_up_again(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.boot_up()
    link.poll()
    drive.written.clear()
    amplifier.stop()
    amplifier.enable()
    assert (0x1A01, 0, 2) in drive.written
    assert amplifier.status().state is DriveState.ENABLED


def test_a_heartbeat_that_ends_shows_by_its_age(world, drive, link, open_drive):
    amplifier = open_drive(heartbeat=0.05)
    amplifier.enable()
    assert amplifier.heartbeat_timeout_ns == 150_000_000
    drive.deaf = True
    for _ in range(200):
        link.wait()
    assert world.clock.ns - amplifier.status().heartbeat_ns > amplifier.heartbeat_timeout_ns


def test_stop(drive, link, open_drive):
    amplifier = open_drive(watchdog=0.1)
    amplifier.enable()
    amplifier.command(0.2)
    amplifier.stop()
    assert drive.commands[-1] == (OFF, 10, 0)
    assert drive.parameters[0x6040, 0] == bytes(2)  # by the other way too
    assert drive.parameters[0x1016, 1] != bytes(4)  # until it has said that it is off
    link.wait()
    link.wait()
    assert amplifier.status().state is DriveState.IDLE
    assert drive.parameters[0x1016, 1] == bytes(4)


def test_a_drive_that_does_not_obey_the_stop_is_still_watched(drive, link, open_drive):
    amplifier = open_drive(watchdog=0.1)
    amplifier.enable()
    drive.step = lambda controlword: None
    amplifier.stop()
    for _ in range(20):
        link.wait()
    assert amplifier.status().state is DriveState.ENABLED
    assert drive.parameters[0x1016, 1] != bytes(4)


def test_a_stopped_drive_is_heard_again(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.state = NmtState.PRE_OPERATIONAL
    drive.heartbeat()
    link.poll()
    amplifier.stop()
    for _ in range(120):
        link.wait()
    assert amplifier.node.operational
    amplifier.take_motion()
    link.wait()
    assert amplifier.take_motion()


def test_a_drive_that_says_only_after_the_stop_that_it_has_left_operation_is_heard_again(drive, link, open_drive):
    """Its fault comes with the statusword at once, its state of network management with the next heartbeat."""
    amplifier = open_drive()
    amplifier.enable()
    drive.where = State.FAULT
    drive.report()
    drive.emergency(0x8130)
    drive.state = NmtState.PRE_OPERATIONAL
    link.poll()
    assert amplifier.made_itself_safe() is True
    assert amplifier.node.operational  # as far as is known
    drive.orders.clear()
    amplifier.stop()
    assert drive.orders == []
    for _ in range(120):
        link.wait()
    assert drive.orders == [NmtCommand.START]
    amplifier.take_motion()
    link.wait()
    assert amplifier.take_motion()


def test_stop_never_raises(world, drive, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    world.bus.broken = True
    amplifier.stop()
    with pytest.raises(ConnectionFailedError):
        amplifier.command(0.0)


def test_eds_files_are_shipped():
    assert {path.stem for path in Path(canopen_node.SHIPPED).glob("*.eds")} == {"cia402", "torque-sensor"}


def test_sdo_answers_that_nobody_waits_for_are_no_twin(drive, link, open_drive):
    """No error is raised: they are not taken for those of a second drive with the same number."""
    amplifier = open_drive()
    amplifier.enable()
    amplifier.stop()
    for _ in range(10):
        link.wait()
    amplifier.identify()


def test_no_frame_brings_the_driver_down(world, drive, link, open_drive):
    amplifier, random = open_drive(current_per_unit=1e-3), Random(5)
    for _ in range(4000):
        identifier = random.choice((0x000, 0x080, 0x085, 0x185, 0x285, 0x585, 0x605, 0x705, random.getrandbits(11)))
        world.bus.arrive(identifier, random.randbytes(random.randint(0, 8)), remote=random.random() < 0.02)
        link.poll()
        amplifier.status()
    assert len(amplifier.take_motion()) > 20
    assert amplifier.node.malformed > 500
