"""The emulated torque sensors: what their bytes say, and how tests make them lie."""

from collections.abc import Callable
from dataclasses import replace
from math import isnan, nan

import cantools
import numpy as np
import pytest

from norton_drivers.codecs.bota import BotaFrame, BotaStream
from norton_drivers.dbc_sensor import SHIPPED
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.bota import BotaSensor
from norton_sim.firmware.can_sensors import DbcSensor

MS = 1_000_000
Bench = Callable[..., SimulatedBackend]
MESSAGE = cantools.database.load_file(SHIPPED / "torque-sensor.dbc").get_message_by_name("TorqueReading")


def bota_frames(backend: SimulatedBackend, duration_ms: int, change: Callable[[BotaSensor], object]) -> list[BotaFrame]:
    """What arrives after ``change``, which is made once the line is open."""
    line = backend.open_serial("/tmp/bota", 460_800).line
    sensor = backend.world.devices["torque_sensor"]
    assert isinstance(sensor, BotaSensor)
    backend.clock.wait_until_ns(10 * MS)
    change(sensor)
    backend.clock.wait_until_ns(13 * MS)
    while line.read(1000):
        pass
    data = bytearray()
    for tick in range(14, 14 + duration_ms):
        backend.clock.wait_until_ns(tick * MS)
        while piece := line.read(1000):
            data += piece
    stream = BotaStream()
    frames = stream.feed(bytes(data))
    assert stream.crc_errors == 0
    return frames


def test_bota_streams_a_frame_each_millisecond_of_its_own_clock(wiring: Wiring, open_bench: Bench) -> None:
    frames = bota_frames(open_bench(wiring), 1000, lambda _: None)
    assert abs(len(frames) - 1000) <= 2
    steps_us = np.diff([frame.timestamp_us for frame in frames]) % (1 << 32)
    # Its clock counts its own milliseconds exactly, rounded to microseconds.
    assert set(steps_us) <= {999, 1000, 1001}
    assert steps_us.mean() == pytest.approx(1000, abs=0.01)
    assert {frame.status for frame in frames} == {0}


def test_bota_reports_bias_and_noise_about_its_axis(wiring: Wiring, open_bench: Bench) -> None:
    wiring = replace(
        wiring, torque_sensor=DeviceSettings("torque_sensor", "bota", port="/tmp/bota", options={"axis": "x"})
    )
    frames = bota_frames(open_bench(wiring), 2000, lambda _: None)
    torques_nm = np.array([frame.torque_x_nm for frame in frames])
    assert torques_nm.mean() == pytest.approx(3e-3, abs=4 * 1e-3 / np.sqrt(len(frames)))
    assert torques_nm.std() == pytest.approx(1e-3, rel=0.07)
    assert {(frame.torque_y_nm, frame.torque_z_nm) for frame in frames} == {(0.0, 0.0)}


def test_bota_faults(wiring: Wiring, open_bench: Bench) -> None:
    frozen = bota_frames(open_bench(wiring), 20, lambda sensor: sensor.freeze())
    assert len({frame.torque_z_nm for frame in frozen}) == 1
    assert len({frame.timestamp_us for frame in frozen}) == len(frozen)
    poisoned = bota_frames(open_bench(wiring), 20, lambda sensor: sensor.signal.force(nan))
    assert all(isnan(frame.torque_z_nm) for frame in poisoned)
    complaining = bota_frames(open_bench(wiring), 20, lambda sensor: setattr(sensor, "status", 2))
    assert {frame.status for frame in complaining} == {2}


def dbc_values(
    backend: SimulatedBackend, wiring: Wiring, change: Callable[[DbcSensor], object]
) -> list[dict[str, float]]:
    bus = backend.open_can(wiring.buses[0]).bus
    sensor = backend.world.devices["torque_sensor"]
    assert isinstance(sensor, DbcSensor)
    change(sensor)
    backend.clock.wait_until_ns(100 * MS)
    frames = [frame for frame in iter(lambda: bus.recv(0), None) if frame.arbitration_id == MESSAGE.frame_id]
    return [MESSAGE.decode(bytes(frame.data), decode_choices=False) for frame in frames]


def test_dbc_sensor_counts_and_is_well(dbc_wiring: Wiring, open_bench: Bench) -> None:
    values = dbc_values(open_bench(dbc_wiring), dbc_wiring, lambda _: None)
    assert abs(len(values) - 100) <= 1
    assert set(np.diff([value["Counter"] for value in values])) == {1}
    assert {value["Status"] for value in values} == {0}
    assert np.mean([value["Torque"] for value in values]) == pytest.approx(3e-3, abs=4e-4)


def test_dbc_sensor_saturates_and_says_when_it_has_no_value(dbc_wiring: Wiring, open_bench: Bench) -> None:
    most = (2**31 - 1) * 1e-6
    beyond = dbc_values(open_bench(dbc_wiring), dbc_wiring, lambda sensor: sensor.signal.force(1e9))
    assert [value["Torque"] for value in beyond] == pytest.approx([most] * len(beyond))
    assert {value["Status"] for value in beyond} == {0}
    poisoned = dbc_values(open_bench(dbc_wiring), dbc_wiring, lambda sensor: sensor.signal.force(nan))
    assert {value["Status"] for value in poisoned} == {1}
    frozen = dbc_values(open_bench(dbc_wiring), dbc_wiring, lambda sensor: sensor.freeze())
    assert len({value["Torque"] for value in frozen}) == 1
    assert set(np.diff([value["Counter"] for value in frozen])) == {1}
