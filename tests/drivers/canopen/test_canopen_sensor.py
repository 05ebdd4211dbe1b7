"""The CANopen torque sensor against a scripted one: what silence means, and when a value is to be trusted."""

import math
import struct
from itertools import pairwise

import pytest

from norton_drivers.canopen.sensor import CanopenSensor, open_torque_sensor
from norton_drivers.codecs.canopen import NmtCommand, NmtState
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from tests.drivers.canopen.canopen_peers import ScriptedSensor

NODE = 3
MS = 1_000_000
GIVEN = {"node": NODE, "scale": 1e-3, "heartbeat": 0.01}


@pytest.fixture
def peer(world):
    return ScriptedSensor(world, NODE)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_sensor(peer, link, device):
    def opened(direction: int = 1, **options: object) -> CanopenSensor:
        settings = device("torque_sensor", "canopen", direction=direction, **{**GIVEN, **options})
        return open_torque_sensor(settings, link)

    return opened


def run(link, sensor, ticks: int) -> list:
    """What is taken in so many ticks of a millisecond."""
    taken = []
    for _ in range(ticks):
        link.wait(MS)
        taken += sensor.take_torque()
    return taken


@pytest.mark.parametrize("direction", [1, -1])
def test_scale_and_sign(world, peer, link, open_sensor, direction):
    sensor = open_sensor(direction, range=2.0)
    peer.value(-750)
    link.poll()
    (reading,) = sensor.take_torque()
    assert reading.torque_nm == pytest.approx(direction * -0.75)
    assert (reading.sequence, reading.arrival_ns, reading.valid, reading.device_ns) == (0, world.clock.ns, True, None)
    assert sensor.range_nm == 2.0


def test_it_is_started_with_a_heartbeat(peer, open_sensor):
    open_sensor()
    assert peer.orders == [NmtCommand.PRE_OPERATIONAL, NmtCommand.START]
    assert peer.parameters[0x1017, 0] == struct.pack("<H", 10)
    assert [entry for entry in peer.written if entry[0] >= 0x1800] == []


def test_the_value_that_it_sends_when_it_is_started_counts(peer, link, open_sensor):
    """It comes before the first heartbeat that says so, and may be the last for long."""
    obey = peer.obey

    def obey_and_send(order):
        obey(order)
        if order.command is NmtCommand.START:
            peer.value(70)

    peer.obey = obey_and_send
    peer.boot_up()  # just switched on
    sensor = open_sensor()
    sensor.identify()
    assert {reading.torque_nm for reading in run(link, sensor, 50)} == {0.07}


def test_a_heartbeat_that_cannot_be_set_but_is_right_already(peer, open_sensor):
    peer.parameters[0x1017, 0] = struct.pack("<H", 10)
    peer.aborts[0x1017, 0] = 0x06010002
    open_sensor()
    assert peer.state is NmtState.OPERATIONAL


def test_silence_with_a_heartbeat_is_the_same_value_again(peer, link, open_sensor):
    sensor = open_sensor()
    peer.value(100)
    readings = run(link, sensor, 300)
    assert len(readings) == pytest.approx(300, abs=3)
    assert {reading.torque_nm for reading in readings} == {0.1}
    assert {b.arrival_ns - a.arrival_ns for a, b in pairwise(readings)} == {MS}
    assert {reading.sequence for reading in readings} == {0}  # one message, said again


def test_a_value_left_out_here_and_there_leaves_readings_as_regular_as_the_sensor(world, peer, link, open_sensor):
    sensor = open_sensor()
    taken, start_ns = [], world.clock.ns
    for tick in range(200):
        if tick % 5 not in (2, 3):  # these have not changed
            world.clock.wait_until_ns(start_ns + tick * MS + 600_000)
            peer.value(tick)
            link.poll()
        world.clock.wait_until_ns(start_ns + (tick + 1) * MS)
        link.poll()
        taken += sensor.take_torque()
    assert {b.arrival_ns - a.arrival_ns for a, b in pairwise(taken)} == {MS}
    digits = [round(reading.torque_nm * 1e3) for reading in taken]
    assert digits[:10] == [0, 1, 1, 1, 4, 5, 6, 6, 6, 9]


def test_a_value_that_is_late_is_waited_for(world, peer, link, open_sensor):
    sensor = open_sensor()
    peer.value(1)
    link.poll()
    world.clock.ns += round(2.9 * MS)
    assert len(sensor.take_torque()) == 1
    peer.value(2)
    link.poll()
    readings = sensor.take_torque()
    assert [reading.torque_nm for reading in readings] == [0.001, 0.001, 0.002]  # two were left out, or are late
    assert [reading.sequence for reading in readings] == [0, 0, 1]


def test_without_its_heartbeat_silence_is_silence(world, peer, link, open_sensor):
    sensor = open_sensor()
    peer.value(100)
    run(link, sensor, 50)
    peer.deaf = True
    readings = run(link, sensor, 100)
    heard_ns = sensor.node.heartbeat_ns
    assert readings
    assert max(reading.arrival_ns for reading in readings) <= heard_ns + 30 * MS
    assert world.clock.ns - heard_ns > 90 * MS


@pytest.mark.parametrize("state", [NmtState.STOPPED, NmtState.PRE_OPERATIONAL])
def test_a_sensor_that_left_operation_is_silent(peer, link, open_sensor, state):
    sensor = open_sensor()
    peer.value(100)
    run(link, sensor, 20)
    peer.state = state
    peer.heartbeat()
    link.poll()
    sensor.take_torque()
    assert run(link, sensor, 50) == []


def test_a_sensor_that_restarted_is_silent_until_it_is_set_up_again(peer, link, open_sensor):
    sensor = open_sensor()
    peer.value(100)
    run(link, sensor, 20)
    peer.boot_up()
    link.poll()
    sensor.take_torque()
    peer.state = NmtState.OPERATIONAL  # by somebody else's hand
    peer.value(200)
    assert run(link, sensor, 50) == []
    peer.value(0)
    with pytest.raises(DeviceTimeoutError, match="sends no value"):
        sensor.identify(timeout_s=0.02)
    peer.value(300)
    link.poll()
    assert run(link, sensor, 5)[0].torque_nm == pytest.approx(0.3)


def test_after_a_pause_of_ours_old_values_are_not_made_up(world, peer, link, open_sensor):
    sensor = open_sensor()
    peer.value(100)
    run(link, sensor, 20)
    world.clock.ns += 10_000 * MS  # the host was busy: nobody polled
    peer.heartbeat()
    link.poll()
    assert 1 <= len(sensor.take_torque()) <= 3


@pytest.mark.parametrize("send", ["always", "sync", "timer"])
def test_where_it_sends_always_silence_is_silence(peer, link, open_sensor, send):
    sensor = open_sensor(send=send)
    peer.value(100)
    assert len(run(link, sensor, 50)) == 1


@pytest.mark.parametrize(("send", "kind", "timer"), [("sync", 1, 0), ("timer", 255, 2)])
def test_we_can_set_what_makes_it_send(peer, open_sensor, send, kind, timer):
    open_sensor(send=send, period=2e-3)
    assert peer.parameters[0x1800, 2] == bytes([kind])
    assert peer.parameters[0x1800, 5] == struct.pack("<H", timer)
    cob_ids = [value for index, subindex, value in peer.written if (index, subindex) == (0x1800, 1)]
    assert cob_ids == [0x183 | 1 << 31, 0x183]  # off while it is changed


def test_sync_is_sent_for_it(peer, link, open_sensor):
    sensor = open_sensor(send="sync")
    peer.sent.clear()
    run(link, sensor, 50)
    assert len([frame for frame in peer.sent if frame.arbitration_id == 0x80]) == 50


def test_its_status(peer, link, open_sensor):
    sensor = open_sensor(status_mask=0x05)
    trusted = []
    for bits in (None, 0x00, 0x02, 0x04, 0x0102):
        if bits is not None:
            peer.status(bits)
        peer.value(100)
        link.poll()
        trusted.append(sensor.take_torque()[-1].valid)
    assert trusted == [False, True, True, False, True]  # unknown is not well


def test_its_emergencies(peer, link, open_sensor):
    sensor = open_sensor()
    trusted = []
    for code in (None, 0x5000, 0x0000):
        if code is not None:
            peer.emergency(code)
        peer.value(100)
        link.poll()
        trusted.append(sensor.take_torque()[-1].valid)
    assert trusted == [True, False, True]


def test_where_the_value_stands(world, peer, link, open_sensor):
    sensor = open_sensor(pdo=2, type="f32", offset=2, length=8, scale=0.5)
    world.bus.arrive(0x283, b"\0\0" + struct.pack("<f", -3.0) + b"\0\0")
    link.poll()
    assert sensor.take_torque()[0].torque_nm == -1.5


def test_an_identifier_of_its_own(world, peer, link, open_sensor):
    sensor = open_sensor(cob_id=0x1A7, type="i16")
    world.bus.arrive(0x1A7, struct.pack("<h", -5))
    link.poll()
    assert sensor.take_torque()[0].torque_nm == pytest.approx(-0.005)


def test_frames_of_others_and_malformed_ones(world, peer, link, open_sensor):
    sensor = open_sensor(type="f32")
    world.bus.arrive(0x184, bytes(4))
    world.bus.arrive(0x183, bytes(4), extended=True)
    world.bus.arrive(0x183, remote=True)
    link.poll()
    assert (sensor.take_torque(), sensor.node.malformed) == ([], 0)
    world.bus.arrive(0x183, bytes(3))
    world.bus.arrive(0x183, bytes(8))
    world.bus.arrive(0x183, struct.pack("<f", math.nan))
    link.poll()
    assert (sensor.take_torque(), sensor.node.malformed) == ([], 3)


def test_identity(peer, link, open_sensor):
    sensor = open_sensor(status_mask=1)
    peer.value(1)
    peer.status(0)
    identity = sensor.identify()
    assert (identity.driver, identity.address) == ("canopen", "can0 node 3")
    assert (identity.hardware, identity.firmware) == ("a device's long name", "7.1")


@pytest.mark.parametrize(
    ("options", "say", "sentence"),
    [
        ({}, lambda peer: None, r"sends no value of 4 bytes \(identifier 0x183\) in 0\.1 s.*turn the shaft"),
        (
            {"status_mask": 1},
            lambda peer: peer.value(1),
            r"sends no status \(identifier 0x283\)",
        ),
    ],
)
def test_silence_at_the_start(peer, open_sensor, options, say, sentence):
    sensor = open_sensor(**options)
    say(peer)
    with pytest.raises(DeviceTimeoutError, match=sentence):
        sensor.identify(timeout_s=0.1)


def test_a_drive_is_no_sensor(peer, open_sensor):
    peer.parameters[0x1000, 0] = struct.pack("<I", 0x00020192)
    with pytest.raises(DeviceError, match=r"says that it is a drive \(profile 402\); is this the node id meant"):
        open_sensor()


def test_nobody_there(peer, open_sensor):
    peer.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"\[torque_sensor\] CANopen node 3 on can0: does not answer"):
        open_sensor()


@pytest.mark.parametrize("name", GIVEN)
def test_what_must_be_given(link, device, name):
    given = {key: value for key, value in GIVEN.items() if key != name}
    with pytest.raises(WiringError, match=rf'\[torque_sensor\] driver = "canopen" needs {name}: '):
        open_torque_sensor(device("torque_sensor", "canopen", **given), link)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"scale": 0.0}, "scale = 0.0: must not be 0"),
        ({"offset": 6}, "an i32 at offset = 6 does not fit into length = 10"),
        ({"length": 2}, "an i32 at offset = 0 does not fit into length = 2"),
        ({"send": "sometimes"}, "send = 'sometimes'"),
        ({"eds": "no-such"}, 'eds = "no-such" is neither a file nor one of the shipped: cia402, torque-sensor'),
    ],
)
def test_wrong_options(peer, open_sensor, options, sentence):
    with pytest.raises(WiringError, match=sentence):
        open_sensor(**options)
