"""Frames and bytes that are lost, late, doubled, out of order or wrong: against the same world without the fault."""

import errno
from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import can
import numpy as np
import pytest
import serial

from norton_drivers.errors import ConnectionFailedError
from norton_sim.connectors import CAN_ERR_BUS_OFF, TRANSMIT_QUEUE
from norton_sim.faults.schema import BabblingNode, BusOff, Corrupt, Delay, Drop, Dropout, Duplicate, Reorder, Unplugged
from tests.sim_backend.faults.conftest import MS, Host

MakeHost = Callable[..., Host]
ESTIMATES, ACTUATOR, LOAD = 9, 1, 2


def heard(host: Host, duration_ms: int = 200) -> list[tuple[int, int, bytes]]:
    host.listen(duration_ms)
    return host.frames


def test_one_frame_is_lost_and_no_other(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(fault := Drop(on="actuator", at_s=0.05, count=1, towards="host"))
    lost = set(heard(clean)) - set(heard(host))
    assert len(lost) == 1
    assert len(host.frames) == len(clean.frames) - 1
    ((arrival_ns, arbitration_id, _),) = lost
    assert arbitration_id >> 5 == ACTUATOR
    assert 50 * MS < arrival_ns < 52 * MS
    (injected,) = host.backend.injected
    assert (injected.fault, injected.begun_ns, injected.hits) == (fault, 50 * MS, 1)


def test_a_share_of_all_that_is_on_the_bus_is_lost_for_a_while(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(Drop(on="can0", at_s=0.1, lasts_s=0.5, share=0.1, towards="host"))
    lost = set(heard(clean, 700)) - set(heard(host, 700))
    hits = host.backend.injected[0].hits
    assert len(lost) == hits
    # About 1120 frames in half a second; five standard deviations.
    assert hits == pytest.approx(112, abs=50)
    assert {arbitration_id >> 5 for _, arbitration_id, _ in lost} == {ACTUATOR, LOAD}
    assert all(100 * MS < arrival_ns < 602 * MS for arrival_ns, _, _ in lost)


def test_frames_come_twice(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(Duplicate(on="load", at_s=0.05, count=20, towards="host"))
    more = Counter(heard(host)) - Counter(heard(clean))
    assert sum(more.values()) == 20
    assert {arbitration_id >> 5 for _, arbitration_id, _ in more} == {LOAD}
    assert len(host.frames) == len(clean.frames) + 20


def test_frames_change_places(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(Reorder(on="actuator", at_s=0.05, count=5, towards="host"))
    for each in (clean, host):
        each.backend.world.plant.command("actuator", 0.3)  # so that no two estimates are alike
        heard(each)
    before, after = clean.of(ACTUATOR, ESTIMATES), host.of(ACTUATOR, ESTIMATES)
    moved = [index for index, data in enumerate(before) if after[index] != data]
    assert sorted(before) == sorted(after)
    assert 0 < len(moved) <= 10
    assert all(48 <= index <= 62 for index in moved)


def test_frames_are_late_in_their_order_and_all_come_in_the_end(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(Delay(on="actuator", at_s=0.05, lasts_s=0.1, by_s=0.02, towards="host"))
    for each in (clean, host):
        each.backend.world.plant.command("actuator", 0.3)
        heard(each)
    assert host.of(ACTUATOR, ESTIMATES) == clean.of(ACTUATOR, ESTIMATES)
    on_time = {data: arrival_ns for arrival_ns, arbitration_id, data in clean.frames if arbitration_id == 0x29}
    late_ms = {
        on_time[data] // MS: (arrival_ns - on_time[data]) / MS
        for arrival_ns, arbitration_id, data in host.frames
        if arbitration_id == 0x29
    }
    assert all(abs(late) < 0.2 for at, late in late_ms.items() if at < 50 or at > 151)
    assert all(late == pytest.approx(20, abs=0.2) for at, late in late_ms.items() if 52 < at < 128)


@pytest.mark.parametrize("bits", [1, 3])
def test_bits_are_flipped_where_the_check_is_missed(make_host: MakeHost, bits: int) -> None:
    fault = Corrupt(on="actuator", at_s=0.05, count=4, bits=bits, crc="missed", towards="host")
    clean, host = make_host(), make_host(fault)
    wrong = [
        (right[2], other[2]) for right, other in zip(heard(clean), heard(host), strict=True) if right[2] != other[2]
    ]
    assert len(wrong) == 4
    for right, other in wrong:
        assert (int.from_bytes(right) ^ int.from_bytes(other)).bit_count() == bits
    assert host.port.error_frames == 0


def test_what_the_check_catches_is_sent_again_and_reported(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(Corrupt(on="can0", at_s=0.05, count=10, towards="host"))
    right, again = heard(clean), heard(host)
    assert Counter(frame[1:] for frame in right) == Counter(frame[1:] for frame in again)
    late = [other[0] - one[0] for one, other in zip(sorted(right), sorted(again), strict=True) if other[0] != one[0]]
    assert late
    assert max(late) < MS
    assert host.port.error_frames == 10


def test_a_serial_sensors_own_check_counts_what_was_corrupted(make_host: MakeHost) -> None:
    host = make_host(Corrupt(on="torque_sensor", at_s=0.05, count=3, bits=2))
    host.listen(200)
    assert host.sensor.malformed == 3
    assert len(host.sensor.take_torque()) == pytest.approx(197, abs=2)


def test_bytes_are_lost_and_doubled_a_message_at_a_time(make_host: MakeHost) -> None:
    host = make_host(
        Drop(on="torque_sensor", at_s=0.05, count=5, towards="host"),
        Duplicate(on="torque_sensor", at_s=0.1, count=5, towards="host"),
    )
    host.listen(200)
    sent_us = [reading.device_ns // 1000 for reading in host.sensor.take_torque()]
    steps_ms = [round((later - earlier) / 1000) for earlier, later in pairwise(sent_us)]
    assert Counter(steps_ms)[0] == 5
    assert sum(step - 1 for step in steps_ms if step > 1) == 5
    assert host.sensor.malformed == 0


def test_a_frame_of_the_hosts_is_lost_for_every_device_or_none(make_host: MakeHost) -> None:
    host = make_host(Drop(on="can0", share=0.5, towards="device"))
    got: dict[str, list[int]] = {"actuator": [], "load": []}
    for role, seen in got.items():
        host.backend.world.wires[role].on_frame(lambda message, seen=seen: seen.append(message.data[0]))
    for number in range(100):
        host.port.bus.send(can.Message(arbitration_id=0x7F0, is_extended_id=False, data=bytes([number])))
        host.listen(1)
    assert got["actuator"] == got["load"]
    assert 25 < len(got["load"]) < 75
    assert host.backend.injected[0].hits == 100 - len(got["load"])


def test_the_same_seed_hits_the_same_frames(make_host: MakeHost) -> None:
    fault = Drop(on="can0", share=0.2)
    first, again, other = (heard(make_host(fault, seed=seed)) for seed in (1, 1, 2))
    assert first == again
    assert first != other


FRAME = can.Message(arbitration_id=0x7F0, is_extended_id=False, data=bytes(8))


def test_an_unplugged_adapter_raises_for_whoever_uses_it(make_host: MakeHost) -> None:
    host = make_host(Unplugged(on="can0", at_s=0.1))
    host.listen(99)
    with pytest.raises(ConnectionFailedError, match=r"bus can0: lost .*No such device"):
        host.listen(3)
    with pytest.raises(can.CanOperationError, match="No such device") as caught:
        host.port.bus.send(FRAME)
    assert caught.value.error_code == errno.ENODEV


def test_so_does_an_unplugged_serial_adapter(make_host: MakeHost) -> None:
    host = make_host(Unplugged(on="torque_sensor", at_s=0.1))
    host.listen(99)
    with pytest.raises(ConnectionFailedError, match=r"port /tmp/bota: lost .*Input/output error"):
        host.listen(3)
    port = host.link.serial_ports["/tmp/bota"]
    with pytest.raises(serial.SerialException, match="write failed"):
        port.line.write(b"?")
    with pytest.raises(ConnectionFailedError, match="cannot write"):
        port.send(b"?")


def test_a_controller_that_is_bus_off_is_told_by_an_error_frame_and_a_queue_that_fills(make_host: MakeHost) -> None:
    host = make_host(BusOff(on="can0", at_s=0.1, lasts_s=0.1))
    bus = host.backend.open_can(host.link.buses[0]).bus
    host.backend.clock.wait_until_ns(110 * MS)
    heard = list(iter(lambda: bus.recv(0), None))
    assert heard[-1].is_error_frame
    assert heard[-1].arbitration_id & CAN_ERR_BUS_OFF
    host.backend.clock.wait_until_ns(190 * MS)
    assert bus.recv(0) is None
    for _ in range(TRANSMIT_QUEUE):
        bus.send(FRAME)
    with pytest.raises(can.CanOperationError, match="No buffer space available") as caught:
        bus.send(FRAME)
    assert caught.value.error_code == errno.ENOBUFS
    host.backend.clock.wait_until_ns(250 * MS)
    assert bus.recv(0) is not None
    bus.send(FRAME)


@pytest.mark.parametrize(("kind", "on"), [(Dropout, "actuator"), (BusOff, "actuator"), (Dropout, "torque_sensor")])
def test_a_device_is_silent_for_a_while_and_no_other_is(make_host: MakeHost, kind: type[Dropout], on: str) -> None:
    host = make_host(kind(on=on, at_s=0.05, lasts_s=0.05))
    host.listen(150)
    streams = {
        "actuator": host.actuator.take_motion(),
        "load": host.load.take_motion(),
        "torque_sensor": host.sensor.take_torque(),
    }
    for name, readings in streams.items():
        gap_ns = np.max(np.diff([reading.arrival_ns for reading in readings]))
        assert gap_ns == pytest.approx(51 * MS if name == on else MS, abs=1.1 * MS)


def test_a_silent_drive_is_deaf_too(make_host: MakeHost) -> None:
    host = make_host()
    host.enable()
    host.backend.inject(Dropout(on="load"))
    host.drive((0.0, 0.2), 50)
    assert not host.backend.world.plant.drives("load")
    assert host.backend.world.devices["load"].armed


def test_a_babbling_node_is_heard_and_starves_everybody(make_host: MakeHost) -> None:
    host = make_host(BabblingNode(on="can0", at_s=0.1, lasts_s=0.1))
    host.listen(250)
    by_node = {node: [at for at, identifier, _ in host.frames if identifier >> 5 == node] for node in (0, 1, 2)}
    # A megabit a second, 135 bits a frame.
    assert len(by_node[0]) == pytest.approx(0.1e6 / 135, rel=0.01)
    for node in (1, 2):
        assert not [at for at in by_node[node] if 101 * MS < at < 200 * MS]
        assert np.max(np.diff(by_node[node])) > 99 * MS
    assert [at for at in by_node[1] if at > 205 * MS]


def test_a_node_that_takes_part_of_the_bus_only_makes_the_others_wait(make_host: MakeHost) -> None:
    clean, host = make_host(), make_host(BabblingNode(on="can0", at_s=0.05, lasts_s=0.1, load=0.3, arbitration_id=5))
    for each in (clean, host):
        each.listen(200)
    foreign = [frame for frame in host.frames if frame[1] == 5]
    own = [frame for frame in host.frames if frame[1] != 5]
    assert len(foreign) == pytest.approx(0.3 * 0.1e6 / 135, rel=0.02)
    assert sorted(frame[1:] for frame in own) == sorted(frame[1:] for frame in clean.frames)
    waits_ns = [late[0] - on_time[0] for late, on_time in zip(sorted(own), sorted(clean.frames), strict=True)]
    assert 0 < max(waits_ns) < 3 * MS


@pytest.mark.parametrize("load", [0.8, 1.0])
def test_a_crowded_bus_fills_the_hosts_queue(make_host: MakeHost, load: float) -> None:
    host = make_host()
    host.enable()
    host.backend.inject(BabblingNode(on="can0", load=load, lasts_s=0.05))
    with pytest.raises(ConnectionFailedError, match=r"cannot send .*No buffer space available"):
        host.drive((0.05, 0.0), 40)
    host.listen(60)
    host.drive((0.05, 0.0), 5)
    assert host.backend.world.plant.true_current_a("actuator") == pytest.approx(0.9, rel=0.1)
