"""Adapters, controllers and cables that are gone, as python-can and pyserial tell of it, and a bus that others fill."""

import errno
from collections.abc import Callable

import can
import numpy as np
import pytest
import serial

from norton_drivers.errors import ConnectionFailedError
from norton_sim.faults.schema import BabblingNode, BusOff, Dropout, Unplugged
from norton_sim.transport import CAN_ERR_BUS_OFF, TRANSMIT_QUEUE
from tests.sim_backend.faults.conftest import MS, Host

MakeHost = Callable[..., Host]
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
