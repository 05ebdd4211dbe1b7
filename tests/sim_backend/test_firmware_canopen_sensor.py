"""The emulated CANopen torque sensor: when it sends, what, and how tests make it lie."""

from collections.abc import Callable
from dataclasses import replace
from math import nan
from struct import pack, unpack

import numpy as np
import pytest

from norton_drivers.codecs.canopen import NmtCommand
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.can_sensors import CanopenSensor
from tests.sim_backend.canopen_host import CanopenHost

NODE = 7
VALUE, STATUS, EMERGENCY = 0x180 + NODE, 0x280 + NODE, 0x80 + NODE

OpenHost = Callable[..., CanopenHost]


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> OpenHost:
    def opened(*, noise: str = "1 mN*m", **options: object) -> CanopenHost:
        given = {"node": NODE, "scale": 1e-4, "heartbeat": 0.01, **options}
        changed = replace(wiring, torque_sensor=DeviceSettings("torque_sensor", "canopen", bus="can0", options=given))
        table = {"bias": "3 mN*m", "noise": noise}
        return CanopenHost(open_bench(changed, torque_sensor=table), changed, "torque_sensor", NODE)

    return opened


def digits(host: CanopenHost, duration_ms: int) -> list[int]:
    host.frames(VALUE)
    host.wait(duration_ms)
    return [unpack("<i", data)[0] for data in host.frames(VALUE)]


def test_it_says_who_it_is(open_host: OpenHost) -> None:
    host = open_host()
    assert host.read(0x1000, 0, "<I") & 0xFFFF == 404
    assert host.text(0x1008) == "simulated torque sensor"


def test_it_sends_what_has_changed(open_host: OpenHost) -> None:
    host = open_host()
    assert digits(host, 100) == []  # not before it is started
    host.order(NmtCommand.START)
    values = digits(host, 1000)
    assert 900 < len(values) < 1000
    assert 0 not in np.diff(values)
    assert np.mean(values) * 1e-4 == pytest.approx(3e-3, abs=2e-4)


def test_what_stands_still_is_not_sent(open_host: OpenHost) -> None:
    host = open_host(noise="0 N*m")
    host.order(NmtCommand.START)
    assert digits(host, 1000) == []
    host.firmware.signal.force(0.5)
    assert digits(host, 1000) == [5000]


def test_frozen_it_is_silent_but_alive(open_host: OpenHost) -> None:
    host = open_host()
    host.write(0x1017, 0, "<H", 10)
    host.order(NmtCommand.START)
    host.wait(100)
    host.firmware.freeze()
    host.wait(5)
    host.frames(0x700 + NODE)
    assert digits(host, 1000) == []
    assert len(host.frames(0x700 + NODE)) == pytest.approx(100, abs=1)


def test_always(open_host: OpenHost) -> None:
    host = open_host(noise="0 N*m", send="always")
    host.order(NmtCommand.START)
    assert len(digits(host, 1000)) == pytest.approx(1000, abs=1)


def test_on_sync_and_by_its_timer(open_host: OpenHost) -> None:
    host = open_host(send="sync")
    host.write(0x1800, 1, "<I", VALUE | 1 << 31)
    host.write(0x1800, 2, "<B", 1)
    host.write(0x1800, 1, "<I", VALUE)
    host.order(NmtCommand.START)
    assert digits(host, 100) == []
    host.send(0x80)
    assert len(digits(host, 10)) == 1
    host.order(NmtCommand.PRE_OPERATIONAL)
    host.write(0x1800, 2, "<B", 255)
    host.write(0x1800, 5, "<H", 5)
    host.order(NmtCommand.START)
    assert len(digits(host, 1000)) == pytest.approx(200, abs=1)


def test_its_status(open_host: OpenHost) -> None:
    host = open_host()
    host.order(NmtCommand.START)
    host.wait(1)
    assert host.frames(STATUS) == [b"\0\0"]  # once when it starts
    host.firmware.status = 0x104
    host.wait(1)
    assert host.frames(STATUS) == [b"\x04\x01"]


@pytest.mark.parametrize(
    ("options", "identifier", "layout"),
    [
        ({"type": "i16", "offset": 1, "length": 5}, VALUE, "<xhxx"),
        ({"type": "f32", "pdo": 3}, 0x380 + NODE, "<f"),
        ({"cob_id": 0x1A1}, 0x1A1, "<i"),
    ],
)
def test_where_the_value_stands(open_host: OpenHost, options: dict[str, object], identifier: int, layout: str) -> None:
    host = open_host(**options)
    host.order(NmtCommand.START)
    host.firmware.signal.force(-0.25)
    host.wait(10)
    assert unpack(layout, host.frames(identifier)[-1])[0] == pytest.approx(-2500)


def test_it_saturates_and_says_when_it_has_no_value(open_host: OpenHost) -> None:
    host = open_host(type="i16")
    assert isinstance(host.firmware, CanopenSensor)
    host.order(NmtCommand.START)
    host.firmware.signal.force(-1e9)
    host.wait(10)
    assert host.frames(VALUE)[-1] == pack("<h", -32767)
    host.firmware.signal.force(nan)
    host.wait(100)
    assert host.frames(VALUE) == []
    host.firmware.signal.force(0.0)
    host.wait(10)
    assert [data[:2] for data in host.frames(EMERGENCY)] == [b"\0\x50", b"\0\0"]
