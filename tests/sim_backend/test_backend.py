"""The simulated backend as the drivers meet it: enabling, stamps, determinism, and what it refuses."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import tau

import can
import numpy as np
import pytest

from norton_drivers.bota import open_torque_sensor
from norton_drivers.dbc_sensor import open_torque_sensor as open_dbc_sensor
from norton_drivers.errors import ConnectionFailedError, WiringError
from norton_drivers.link import Link
from norton_drivers.odrive import ODrive, open_amplifier
from norton_drivers.ports import Backend
from norton_drivers.readings import DriveState, RawFrame
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend, open_backend
from norton_sim.firmware import DRIVERS

MS = 1_000_000
Bench = Callable[..., SimulatedBackend]


def open_drives(backend: Backend, wiring: Wiring) -> tuple[Link, ODrive, ODrive]:
    link = Link(backend, wiring.buses)
    assert wiring.load is not None
    return link, open_amplifier(wiring.actuator, link), open_amplifier(wiring.load, link)


def run(link: Link, drives: tuple[ODrive, ODrive], torques_nm: tuple[float, float], ticks: int) -> None:
    for _ in range(ticks):
        link.wait()
        for drive, torque_nm in zip(drives, torques_nm, strict=True):
            drive.command(torque_nm)


def test_the_real_drivers_enable_and_turn_the_shaft(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    link, actuator, load = open_drives(backend, wiring)
    sensor = open_torque_sensor(wiring.torque_sensor, link)
    assert actuator.identify().firmware == "0.6.10"
    assert sensor.identify().address == "/tmp/bota"
    for drive in (actuator, load):
        drive.enable()
        assert drive.status().state is DriveState.ENABLED
    for readings in (actuator, load):
        readings.take_motion()
    sensor.take_torque()
    run(link, (actuator, load), (0.1, 0.0), 500)
    motions = actuator.take_motion(), load.take_motion()
    # Both report in the bench's sense, though the load is mounted the other way round.
    assert motions[0][-1].velocity_rad_s > 10
    assert motions[1][-1].velocity_rad_s == pytest.approx(motions[0][-1].velocity_rad_s, rel=0.01)
    # Read within a millisecond of each other.
    assert abs(motions[0][-1].position_rad - motions[1][-1].position_rad) < 1e-3 * motions[0][-1].velocity_rad_s + 1e-3
    # The actuator drags the load: the torque it exerts is positive, beyond the sensor's bias and noise.
    assert np.mean([reading.torque_nm for reading in sensor.take_torque()]) > 0.01
    assert actuator.take_current()[-1].current_a == pytest.approx(1.8, abs=0.1)
    actuator.stop()
    load.stop()
    link.wait(250 * MS)
    assert actuator.status().state is DriveState.IDLE
    assert (actuator.malformed, load.malformed, sensor.malformed) == (0, 0, 0)


def test_the_dbc_sensor_reads_the_same_torque(dbc_wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(dbc_wiring)
    link, actuator, load = open_drives(backend, dbc_wiring)
    sensor = open_dbc_sensor(dbc_wiring.torque_sensor, link)
    sensor.identify()
    actuator.enable()
    run(link, (actuator, load), (0.1, 0.0), 1000)
    readings = sensor.take_torque()[-200:]
    assert (sensor.malformed, sensor.repeats) == (0, 0)
    # Bias 3 mN m; noise 1 mN m, of which 200 readings leave a fourteenth.
    measured = np.mean([reading.torque_nm for reading in readings])
    assert measured == pytest.approx(backend.world.plant.true_port_torque_nm() + 3e-3, abs=1e-3)


def test_a_silent_host_is_noticed_by_the_watchdog(wiring: Wiring, open_bench: Bench) -> None:
    link, actuator, load = open_drives(open_bench(wiring), wiring)
    actuator.enable()
    run(link, (actuator, load), (0.1, 0.0), 100)
    assert actuator.status().state is DriveState.ENABLED
    link.wait(90 * MS)
    run(link, (actuator, load), (0.1, 0.0), 50)
    assert actuator.status().state is DriveState.ENABLED
    for _ in range(25):
        link.wait(10 * MS)
    assert actuator.status().state is DriveState.FAULT
    assert any("watchdog" in words for words in actuator.status().errors)
    actuator.enable()
    assert actuator.status().state is DriveState.ENABLED


def test_stamps_are_neither_old_nor_of_the_future(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    link, actuator, _ = open_drives(backend, wiring)
    sensor = open_torque_sensor(wiring.torque_sensor, link)
    for _ in range(4000):
        link.wait()
        for reading in (*actuator.take_motion(), *sensor.take_torque()):
            assert backend.clock.now_ns() - 2 * MS < reading.arrival_ns <= backend.clock.now_ns()


@pytest.mark.parametrize(("stream", "jitter_ns"), [("motion", 50_000), ("torque", 100_000)])
def test_jitter_and_the_devices_own_clock(wiring: Wiring, open_bench: Bench, stream: str, jitter_ns: int) -> None:
    link, actuator, _ = open_drives(open_bench(wiring), wiring)
    sensor = open_torque_sensor(wiring.torque_sensor, link)
    for _ in range(4000):
        link.wait()
    readings = {"motion": actuator.take_motion, "torque": sensor.take_torque}[stream]()
    stamps = np.array([reading.arrival_ns for reading in readings], float)
    count = np.arange(len(stamps))
    line = np.polyfit(count, stamps, 1)
    residual = stamps - np.polyval(line, count)
    # Uniform within ± jitter about the device's own regular instants.
    assert residual.std() == pytest.approx(jitter_ns / np.sqrt(3), rel=0.06)
    assert abs(residual).max() < 1.1 * jitter_ns
    # A crystal of its own: near a millisecond, and never just that.
    assert 0 < abs(line[0] - MS) <= 50 + 4 * residual.std() * np.sqrt(12) / len(count) ** 1.5


def recorded(backend: SimulatedBackend, wiring: Wiring) -> list[RawFrame]:
    link, actuator, load = open_drives(backend, wiring)
    frames: list[RawFrame] = []
    open_torque_sensor(wiring.torque_sensor, link)
    link.set_tap(frames.append)
    actuator.enable()
    run(link, (actuator, load), (0.05, 0.0), 100)
    return frames


def test_the_same_seed_gives_the_same_bytes(wiring: Wiring, open_bench: Bench) -> None:
    first, again, other = (recorded(open_bench(wiring, seed), wiring) for seed in (1, 1, 2))
    assert len(first) > 500
    assert first == again
    assert first != other


def test_receiving_waits_in_simulated_time(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    bus = backend.open_can(wiring.buses[0]).bus
    assert bus.recv(0) is None
    first = bus.recv(1.0)
    assert first is not None
    assert round(first.timestamp * 1e9) == backend.clock.now_ns() < 3 * MS
    bus.set_filters([{"can_id": 2 << 5 | 1, "can_mask": 0x7FF, "extended": False}])
    heartbeat = bus.recv(1.0)
    assert heartbeat is not None
    assert heartbeat.arbitration_id == 0x41
    bus.set_filters([{"can_id": 0x7FF, "can_mask": 0x7FF, "extended": False}])
    before_ns = backend.clock.now_ns()
    assert bus.recv(0.01) is None
    assert backend.clock.now_ns() == before_ns + 10 * MS


def test_every_host_hears_the_devices_and_none_hears_itself(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    one, two = (backend.open_can(wiring.buses[0]).bus for _ in range(2))
    one.send(can.Message(arbitration_id=1 << 5, is_remote_frame=True, dlc=8, is_extended_id=False))
    backend.clock.wait_until_ns(20 * MS)
    heard = [[message.arbitration_id for message in iter(partial(bus.recv, 0), None)] for bus in (one, two)]
    assert heard[0] == heard[1]
    assert heard[0].count(1 << 5) == 1


def test_a_pulled_plug_is_silent_both_ways(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    link, actuator, load = open_drives(backend, wiring)
    sensor = open_torque_sensor(wiring.torque_sensor, link)
    run(link, (actuator, load), (0.0, 0.0), 10)
    for role in ("actuator", "torque_sensor"):
        backend.world.wires[role].cut()
    run(link, (actuator, load), (0.0, 0.0), 5)  # what was under way still arrives
    for device in (actuator, load):
        device.take_motion()
    sensor.take_torque()
    run(link, (actuator, load), (0.0, 0.0), 10)
    assert (len(actuator.take_motion()), len(load.take_motion()), len(sensor.take_torque())) == (0, 10, 0)
    backend.world.wires["actuator"].mend()
    run(link, (actuator, load), (0.0, 0.0), 10)
    assert len(actuator.take_motion()) >= 8


def test_a_load_that_is_not_wired_is_not_coupled(wiring: Wiring, open_bench: Bench) -> None:
    wiring = replace(wiring, load=None, torque_sensor=None)
    link = Link(open_bench(wiring), wiring.buses)
    actuator = open_amplifier(wiring.actuator, link)
    actuator.enable()
    for _ in range(1000):
        actuator.command(0.1)
        link.wait()
    # The rig's own numbers: (0.9 · 0.1 − 0.02) / 1e-3.
    assert actuator.take_motion()[-1].velocity_rad_s == pytest.approx(70, rel=0.01)


def test_position_is_in_turns_of_the_encoder(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    link, actuator, load = open_drives(backend, wiring)
    actuator.enable()
    run(link, (actuator, load), (0.1, 0.0), 300)
    run(link, (actuator, load), (0.0, 0.0), 700)
    reading = actuator.take_motion()[-1]
    # It stands by now: the encoder's step, and that of a float32 of that many turns.
    truth_rad = backend.world.plant.true_position_rad("actuator")
    assert reading.position_rad == pytest.approx(truth_rad, abs=tau / 131072 + abs(truth_rad) * 2**-24)


def complaint(wiring: Wiring, simulated: dict[str, object]) -> str:
    with pytest.raises(WiringError) as caught:
        open_backend(wiring, simulated, seed=None, place="rig.toml")
    return str(caught.value)


def test_what_cannot_be_simulated_is_refused_in_a_sentence(wiring: Wiring, simulated: dict[str, object]) -> None:
    without_load = {key: value for key, value in simulated.items() if key != "load"}
    unknown = replace(wiring, actuator=replace(wiring.actuator, driver="abacus"))
    lost = replace(wiring, actuator=replace(wiring.actuator, bus="can7"))
    portless = replace(wiring, torque_sensor=DeviceSettings("torque_sensor", "bota"))
    assert "[simulated.load] is missing" in complaint(wiring, without_load)
    assert complaint(wiring, without_load).startswith("rig.toml:")
    assert f"the simulator knows {', '.join(DRIVERS)}" in complaint(unknown, simulated)
    assert "bus = 'can7' is not a bus of this rig (known: can0)" in complaint(lost, simulated)
    assert "needs a serial port" in complaint(portless, simulated)


def test_a_port_with_nothing_behind_it_does_not_open(wiring: Wiring, open_bench: Bench) -> None:
    with pytest.raises(ConnectionFailedError, match="no simulated device is there"):
        open_bench(wiring).open_serial("/dev/ttyUSB7", 115_200)


def test_closing_twice_is_fine(wiring: Wiring, open_bench: Bench) -> None:
    """No error is raised."""
    backend = open_bench(wiring)
    backend.open_can(wiring.buses[0])
    backend.open_serial("/tmp/bota", 460_800)
    backend.close()
    backend.close()


def test_what_the_host_writes_reaches_the_device_when_its_last_byte_does(wiring: Wiring, open_bench: Bench) -> None:
    backend = open_bench(wiring)
    port = backend.open_serial("/tmp/bota", 115_200)
    heard: list[tuple[int, bytes]] = []
    backend.world.wires["torque_sensor"].on_bytes(lambda data: heard.append((backend.world.now_ns, data)))
    port.send(b"first")
    port.send(b"second")
    backend.world.advance(10 * MS)
    assert [data for _, data in heard] == [b"first", b"second"]
    byte_ns = 10e9 / 115_200
    least_ns, most_ns = 300_000, 500_000  # the rig's delay and jitter
    assert least_ns <= heard[0][0] - 5 * byte_ns <= most_ns
    assert heard[1][0] - heard[0][0] >= 6 * byte_ns - 1
