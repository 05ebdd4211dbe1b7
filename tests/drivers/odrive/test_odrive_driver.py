"""The ODrive driver against a scripted drive: what it sends, in which order, and what it makes of what comes."""

import math
import struct
from itertools import pairwise

import can
import pytest

from norton_drivers.codecs import odrive as protocol
from norton_drivers.codecs import odrive_06
from norton_drivers.codecs.odrive import AxisState, MessageId
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.odrive import ODrive, open_amplifier
from norton_drivers.readings import DriveState

NODE = 5
TURN = 2 * math.pi


class ScriptedDrive:
    """Answers as the manual says, through the codec that was held against a third party's file."""

    def __init__(self, world) -> None:
        self.bus, self.clock = world.bus, world.clock
        self.state = AxisState.IDLE
        self.errors = 0
        self.disarm_reason = 0
        self.result = 0
        self.firmware = (0, 6, 10)
        self.parameters = {200: odrive_06.f32_value(0.0), 201: odrive_06.u32_value(0)}
        self.stuck: set[int] = set()
        self.deaf = self.refuses = self.mute_encoder = False
        self.commands: list[tuple[int, bytes]] = []
        self.command_ns: list[int] = []
        self.next_heartbeat_ns = self.clock.ns + 50_000_000
        world.bus.peer = self.receive
        world.clock.alarms.append(self.tick)

    def say(self, message) -> None:
        self.bus.arrive(protocol.arbitration_id(NODE, message.COMMAND), message.encode())

    def tick(self, now_ns: int) -> None:
        if self.deaf:
            return
        if not self.mute_encoder:
            self.say(protocol.EncoderEstimates(0.0, 0.0))
        if now_ns >= self.next_heartbeat_ns:
            self.next_heartbeat_ns = now_ns + 100_000_000
            self.heartbeat()

    def heartbeat(self) -> None:
        self.say(protocol.Heartbeat(self.errors, self.state, self.result))

    def receive(self, frame: can.Message) -> None:
        node, command = protocol.split_id(frame.arbitration_id)
        assert node == NODE
        self.command_ns.append(self.clock.ns)
        if frame.is_remote_frame:
            self.answer(command)
            return
        self.commands.append((command, bytes(frame.data)))
        if command == MessageId.RX_SDO and not self.deaf:
            self.access(odrive_06.RxSdo.decode(frame.data))
        elif command == MessageId.CLEAR_ERRORS and not self.refuses:
            self.errors = 0
        elif command == MessageId.SET_AXIS_STATE and not self.refuses:
            self.state = protocol.SetAxisState.decode(frame.data).axis_state

    def answer(self, command: int) -> None:
        if command == MessageId.VERSION and not self.deaf:
            self.say(protocol.Version(2, (4, 4, 58), self.firmware))
        elif command == MessageId.ERROR:
            self.say(protocol.GetError(self.errors, self.disarm_reason))

    def access(self, request: odrive_06.RxSdo) -> None:
        if request.opcode == odrive_06.SdoOpcode.WRITE:
            if request.endpoint not in self.stuck:
                self.parameters[request.endpoint] = request.value
        elif request.endpoint in self.parameters:
            self.say(odrive_06.TxSdo(request.endpoint, self.parameters[request.endpoint]))


@pytest.fixture
def drive(world):
    return ScriptedDrive(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_drive(world, link, device):
    def opened(direction: int = 1, **options: object) -> ODrive:
        return open_amplifier(device("actuator", "odrive", direction=direction, node=NODE, **options), link)

    return opened


def test_the_enable_sequence(drive, open_drive):
    amplifier = open_drive(watchdog=0.1)
    amplifier.enable()
    kept = [entry for entry in drive.commands if entry[0] not in (MessageId.RX_SDO,)]
    first = kept.index((MessageId.CLEAR_ERRORS, b"\0"))
    assert kept[first : first + 4] == [
        (MessageId.CLEAR_ERRORS, b"\0"),
        (MessageId.SET_CONTROLLER_MODE, bytes.fromhex("0100000001000000")),
        (MessageId.SET_INPUT_TORQUE, bytes(8)),
        (MessageId.SET_AXIS_STATE, bytes.fromhex("0800000000000000")),
    ]
    assert drive.parameters == {200: odrive_06.f32_value(0.1), 201: odrive_06.u32_value(1)}
    assert amplifier.status().state is DriveState.ENABLED


def test_waiting_feeds_the_watchdog(drive, open_drive):
    open_drive(watchdog=0.02).enable()
    enabled_at = drive.commands.index((MessageId.SET_AXIS_STATE, bytes.fromhex("0800000000000000")))
    gaps = [b - a for a, b in pairwise(drive.command_ns)]
    assert len(gaps) > enabled_at
    assert max(gaps) < 20_000_000


def test_a_watchdog_that_does_not_take_is_refused_before_the_loop_is_closed(drive, open_drive):
    drive.stuck = {201}
    with pytest.raises(
        DeviceError, match=r"\[actuator\] ODrive node 5 on can0: its watchdog does not take 0\.1 s .*off"
    ):
        open_drive().enable()
    assert drive.state is AxisState.IDLE


@pytest.mark.parametrize(
    "parameters", [{200: b"\xff\xff\xff\xff"}, {200: odrive_06.f32_value(-1)}, {201: b"\x07\0\0\0"}]
)
def test_endpoints_of_something_else_are_not_written(drive, open_drive, parameters):
    drive.parameters |= parameters
    with pytest.raises(DeviceError, match=r"has no watchdog where it was looked for.*flat_endpoints"):
        open_drive().enable()
    assert not [data for command, data in drive.commands if command == MessageId.RX_SDO and data[0] == 1]


def test_the_endpoints_are_the_rigs(drive, open_drive):
    drive.parameters = {40: odrive_06.f32_value(0.0), 41: odrive_06.u32_value(0)}
    open_drive(watchdog_timeout_endpoint=40, enable_watchdog_endpoint=41).enable()
    assert drive.parameters == {40: odrive_06.f32_value(0.1), 41: odrive_06.u32_value(1)}


def test_a_drive_without_parameters_is_told_of(drive, open_drive):
    drive.parameters = {}
    with pytest.raises(DeviceTimeoutError, match="does not answer for parameter 200"):
        open_drive().enable()


def test_no_watchdog_where_the_rig_says_so(drive, open_drive):
    open_drive(watchdog=0.0).enable()
    assert MessageId.RX_SDO not in {command for command, _ in drive.commands}


@pytest.mark.parametrize(
    ("errors", "result", "words"), [(1 << 9, 0, "bus voltage too low"), (0, 14, "not calibrated"), (0, 99, "unknown")]
)
def test_a_refusal_is_told_in_the_drives_words(drive, open_drive, errors, result, words):
    drive.refuses, drive.errors, drive.result = True, errors, result
    with pytest.raises(DeviceError, match=f"refuses to close its torque loop: {words}"):
        open_drive().enable()


def test_a_drive_that_says_nothing(drive, open_drive):
    drive.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"did not close its torque loop \(0\.3 s waited\)"):
        open_drive(watchdog=0.0).enable(timeout_s=0.3)
    with pytest.raises(DeviceTimeoutError, match="does not answer; is it powered"):
        open_drive().identify()


def test_old_errors_on_their_way_do_not_fail_the_enable(drive, open_drive):
    drive.errors = 1 << 24
    amplifier = open_drive(watchdog=0.0)
    drive.heartbeat()
    amplifier.enable()
    assert amplifier.status().errors == ()


def test_identity(drive, open_drive):
    identity = open_drive().identify()
    assert (identity.driver, identity.address) == ("odrive", "can0 node 5")
    assert (identity.hardware, identity.firmware) == ("4.4.58", "0.6.10")


def test_another_firmware_is_refused(drive, open_drive):
    drive.firmware = (0, 7, 1)
    with pytest.raises(DeviceError, match=r'says it runs firmware 0\.7\.1; the rig file has firmware = "0\.6"'):
        open_drive().identify()


def test_a_drive_that_sends_no_estimates_is_refused(drive, open_drive):
    drive.mute_encoder = True
    with pytest.raises(DeviceTimeoutError, match="encoder_msg_rate_ms = 1"):
        open_drive().identify()


@pytest.mark.parametrize("direction", [1, -1])
def test_signs(world, drive, link, open_drive, direction):
    amplifier = open_drive(direction=direction)
    drive.say(protocol.EncoderEstimates(0.25, -2.0))
    drive.say(protocol.Iq(9.0, 3.0))
    link.poll()
    (motion,), (current,) = amplifier.take_motion(), amplifier.take_current()
    assert motion.position_rad == pytest.approx(direction * TURN / 4)
    assert motion.velocity_rad_s == pytest.approx(-direction * 2 * TURN)
    assert current.current_a == direction * 3.0
    assert amplifier.command(0.5) == 0.5
    assert protocol.SetInputTorque.decode(world.bus.sent[-1].data).torque_nm == direction * 0.5
    # What is sent is a float32, and that is what is said to have been sent.
    assert amplifier.command(0.1) == struct.unpack("<f", struct.pack("<f", 0.1))[0] != 0.1


def test_each_message_is_one_reading_and_each_reading_is_handed_out_once(world, drive, link, open_drive):
    amplifier = open_drive()
    for _ in range(3):
        drive.say(protocol.EncoderEstimates(1.0, 0.0))  # repeated values are new measurements
    link.poll()
    assert [reading.sequence for reading in amplifier.take_motion()] == [0, 1, 2]
    assert amplifier.take_motion() == []
    drive.say(protocol.EncoderEstimates(1.0, 0.0))
    world.clock.ns += 500
    link.poll()
    (reading,) = amplifier.take_motion()
    assert (reading.sequence, reading.arrival_ns) == (3, world.clock.ns)


def test_frames_of_others_and_malformed_ones(world, drive, link, open_drive):
    amplifier = open_drive()
    estimates = protocol.arbitration_id(NODE, MessageId.ENCODER_ESTIMATES)
    world.bus.arrive(estimates + 32, bytes(8))  # another node
    world.bus.arrive(estimates, bytes(8), extended=True)
    world.bus.arrive(estimates, remote=True)
    world.bus.arrive(protocol.arbitration_id(NODE, 0x1F), bytes(8))
    link.poll()
    assert (amplifier.take_motion(), amplifier.malformed) == ([], 0)
    world.bus.arrive(estimates, bytes(3))
    world.bus.arrive(estimates, b"\xff" * 8)
    world.bus.arrive(protocol.arbitration_id(NODE, MessageId.HEARTBEAT), bytes(2))
    link.poll()
    assert (amplifier.take_motion(), amplifier.malformed) == ([], 3)


def test_losing_closed_loop_is_a_fault_with_the_drives_reason(world, drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.state, drive.disarm_reason = AxisState.IDLE, 1 << 24
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    link.poll()
    assert amplifier.status().errors == ("watchdog expired: no command arrived in time",)


def test_losing_closed_loop_without_a_reason_is_a_fault_all_the_same(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.state = AxisState.IDLE
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("left closed loop without an error (now idle)",)


def test_an_error_is_a_fault_before_and_after_enabling(drive, link, open_drive):
    amplifier = open_drive()
    assert amplifier.status().state is DriveState.UNKNOWN
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.IDLE
    drive.errors = 1 << 13
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("motor too hot",)


def test_errors_cleared_elsewhere_are_forgotten(drive, link, open_drive):
    amplifier = open_drive()
    drive.errors = drive.disarm_reason = 1 << 24
    drive.heartbeat()
    link.poll()
    link.poll()  # the reason, asked for when the heartbeat came
    drive.errors = drive.disarm_reason = 0
    drive.heartbeat()
    link.poll()
    status = amplifier.status()
    assert (status.state, status.errors) == (DriveState.IDLE, ())


def test_status(world, drive, link, open_drive):
    amplifier = open_drive(heartbeat=0.05)
    drive.say(protocol.Temperature(40.0, math.nan))
    drive.say(protocol.BusVoltageCurrent(24.0, 0.1))
    drive.heartbeat()
    link.poll()
    status = amplifier.status()
    assert (status.transistor_temperature_c, status.bus_voltage_v) == (40.0, 24.0)
    assert math.isnan(status.motor_temperature_c)
    assert status.heartbeat_ns == world.clock.ns
    assert amplifier.heartbeat_timeout_ns == 150_000_000


def test_the_heartbeats_age_is_that_of_its_arrival(world, drive, link, open_drive):
    amplifier = open_drive()
    drive.heartbeat()
    link.poll()
    heard_ns = amplifier.status().heartbeat_ns
    drive.deaf = True
    for _ in range(400):
        link.wait()
    assert amplifier.status().heartbeat_ns == heard_ns
    assert world.clock.ns - heard_ns > amplifier.heartbeat_timeout_ns


@pytest.mark.parametrize("turns", [0.0, 0.3, -1.0, 100.0, -1000.0])
@pytest.mark.parametrize("counts", [0, 4096, 131072])
def test_the_resolution_is_the_coarser_of_encoder_and_wire(drive, link, open_drive, turns, counts):
    import numpy as np

    amplifier = open_drive(counts_per_turn=counts)
    drive.say(protocol.EncoderEstimates(turns, 0.0))
    link.poll()
    wire = float(np.spacing(np.float32(abs(turns)))) if turns else 0.0
    expected = TURN * max(wire, 1 / counts if counts else 0.0)
    assert amplifier.position_resolution_rad == pytest.approx(expected, abs=TURN * 2**-24)


def test_stop_is_zero_torque_then_idle(drive, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    amplifier.command(0.3)
    amplifier.stop()
    assert drive.commands[-2:] == [(MessageId.SET_INPUT_TORQUE, bytes(8)), (MessageId.SET_AXIS_STATE, b"\1" + bytes(7))]
    drive.heartbeat()
    assert drive.state == AxisState.IDLE


def test_stop_never_raises_and_tries_both(world, drive, open_drive):
    amplifier = open_drive()
    tried = []
    world.bus.send = lambda message, timeout=None: (tried.append(message.arbitration_id & 31), 1 / 0)
    amplifier.stop()
    assert tried == [MessageId.SET_INPUT_TORQUE, MessageId.SET_AXIS_STATE]


def test_after_stop_idle_is_no_fault(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    amplifier.stop()
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.IDLE


def test_a_torque_that_is_no_number_is_not_sent(world, drive, open_drive):
    amplifier = open_drive()
    before = len(world.bus.sent)
    with pytest.raises(DeviceError, match="cannot command a torque of nan"):
        amplifier.command(math.nan)
    assert len(world.bus.sent) == before


def test_a_lost_bus_is_told(world, drive, open_drive):
    amplifier = open_drive()
    world.bus.broken = True
    with pytest.raises(ConnectionFailedError, match="bus can0: cannot send"):
        amplifier.command(0.0)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, r'\[load\] driver = "odrive" needs node: the drive\'s CAN node id'),
        ({"node": 64}, r"\[load\] node = 64: .*less than or equal to 63"),
        ({"node": 1, "firmware": "0.4"}, r"\[load\] firmware = '0\.4': firmware \"0\.5\" and \"0\.6\""),
        ({"node": 1, "position": "counts", "counts_per_turn": 4096}, r"\[load\] position = 'counts': firmware 0\.6"),
        ({"node": 1, "firmware": "0.5", "position": "counts"}, r"counts mean nothing without counts_per_turn; add it"),
        ({"node": 1, "watchdog": 0.001}, r"\[load\] watchdog = 0\.001: .*at least 20 ms"),
        ({"node": 1, "colour": "red"}, r'\[load\] colour is not an option of driver "odrive"; known: node, firmware'),
    ],
)
def test_wrong_options_are_one_sentence_with_the_place(link, device, options, sentence):
    with pytest.raises(WiringError, match=sentence) as caught:
        open_amplifier(device("load", "odrive", **options), link)
    assert "\n" not in str(caught.value)
