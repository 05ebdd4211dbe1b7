"""The serial torque sensors' drivers in wall time, on pseudo-terminals, against programs that nobody here wrote.

Modbus RTU is spoken by pymodbus' server; lines of text are written by pyserial from another process.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from norton_drivers import ascii_lines, dyn200, mantracourt
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.link import Link
from norton_drivers.readings import TorqueReading
from norton_drivers.wiring import DeviceSettings
from tests.drivers.null_modem import NullModem, null_modem

pytestmark = pytest.mark.wall_time

# A DYN-200 as pymodbus makes one: torque -1234 digits at 0, 60 rpm at 2, 3 decimals at 8, nothing anywhere else.
MODBUS_SERVER = """
import sys
from pymodbus.server import StartSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

numbers = [SimData(0, values=[-1234, 60], datatype=DataType.INT32), SimData(8, values=[3, 0], datatype=DataType.INT32)]
device = SimDevice(1, simdata=numbers if sys.argv[2] == "all" else numbers[1:])
print("ready", flush=True)
StartSerialServer(device, port=sys.argv[1], baudrate=115200, ignore_missing_devices=True)
"""
# A number a millisecond, with a line that is none now and then.
PRINTER = """
import sys, time, serial
port = serial.Serial(sys.argv[1], 115200)
print("ready", flush=True)
for count in range(100000):
    port.write(b"+0.2500 Nm\\r\\n" if count % 50 else b"overload\\r\\n")
    time.sleep(0.001)
"""
# Answers to station 42 alone.
CONVERTER = """
import sys, serial
port = serial.Serial(sys.argv[1], 115200)
print("ready", flush=True)
while True:
    question = port.read_until(b"\\r")
    if question == b"!042:SOUT?\\r":
        port.write(b"+00032.100\\r")
    elif question.startswith(b"!042:"):
        port.write(b"?\\r")
"""


@contextmanager
def program(script: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Another process, once it says that it is ready."""
    with subprocess.Popen([sys.executable, "-c", script, *arguments], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            yield process
        finally:
            process.kill()


@pytest.fixture
def modem() -> Iterator[NullModem]:
    with null_modem() as made:
        yield made


@pytest.fixture
def link() -> Iterator[Link]:
    made = Link(HardwareBackend(), ())
    yield made
    made.close()


def settings(driver: str, port: str, **options: object) -> DeviceSettings:
    return DeviceSettings("torque_sensor", driver, port=port, options=options)


def polled(modem: NullModem, **options: object) -> DeviceSettings:
    return settings("dyn200", modem.near, **{"mode": "polled", "torque_per_digit": 1e-3, "silence": 0.0, **options})


def heard(take: Callable[[], list[TorqueReading]], link: Link, duration_s: float) -> list[TorqueReading]:
    take()
    deadline, readings = time.monotonic() + duration_s, list[TorqueReading]()
    while time.monotonic() < deadline:
        link.wait()
        readings += take()
    return readings


@pytest.mark.long
def test_a_modbus_server_is_known_polled_and_lost(modem: NullModem, link: Link) -> None:
    with program(MODBUS_SERVER, modem.far, "all"):
        sensor = dyn200.open_torque_sensor(polled(modem), link)
        assert sensor.identify(timeout_s=5).hardware == "3 decimals"
        readings = heard(sensor.take_torque, link, 1.0)
        assert len(readings) > 100
        assert {round(reading.torque_nm, 9) for reading in readings} == {-1.234}
        assert isinstance(sensor, dyn200.PolledDyn200)
        delays_ns = sorted(r.arrival_ns - r.device_ns for r in readings if r.device_ns is not None)
        assert 0 < delays_ns[len(delays_ns) // 2] < 10_000_000
    given_up = sensor.questions.unanswered
    assert len(heard(sensor.take_torque, link, 0.3)) <= 1  # one may have been on its way
    assert sensor.questions.unanswered > given_up
    with program(MODBUS_SERVER, modem.far, "all"):  # and found again, without anybody's doing
        assert len(heard(sensor.take_torque, link, 2.0)) > 100


def test_a_modbus_server_without_torque_and_none_at_all(modem: NullModem, link: Link) -> None:
    with program(MODBUS_SERVER, modem.far, "decimals"):
        sensor = dyn200.open_torque_sensor(polled(modem), link)
        with pytest.raises(DeviceError, match=r"refuses to tell its torque \(exception 02, illegal data address\)"):
            sensor.identify(timeout_s=5)
    with pytest.raises(DeviceTimeoutError, match=r"no answer in 0\.5 s"):
        sensor.identify(timeout_s=0.5)


def test_a_port_that_is_pulled_out_is_told(modem: NullModem, link: Link) -> None:
    sensor = dyn200.open_torque_sensor(polled(modem), link)
    link.wait()
    modem.unplug()
    with pytest.raises(ConnectionFailedError, match=f"port {modem.near}: "):
        heard(sensor.take_torque, link, 1.0)


def test_lines_from_a_stranger(modem: NullModem, link: Link) -> None:
    with program(PRINTER, modem.far):
        options = {"scale": 1.0, "unit": "Nm", "width": 10}
        sensor = ascii_lines.open_torque_sensor(settings("ascii", modem.near, **options), link)
        sensor.identify(timeout_s=5)
        readings = heard(sensor.take_torque, link, 1.0)
        assert len(readings) > 200
        assert {reading.torque_nm for reading in readings} == {0.25}
        assert sensor.lines.numbers.garbled >= 3
    link.wait(100_000_000)
    assert heard(sensor.take_torque, link, 0.2) == []


def test_a_converter_of_a_strangers(modem: NullModem, link: Link) -> None:
    with program(CONVERTER, modem.far):
        options = {"scale": 0.01, "averaging": 2e-3, "station": 42, "width": 10}
        sensor = mantracourt.open_torque_sensor(settings("mantracourt", modem.near, **options), link)
        sensor.identify(timeout_s=5)
        readings = heard(sensor.take_torque, link, 1.0)
        assert len(readings) > 100
        assert {round(reading.torque_nm, 9) for reading in readings} == {0.321}
        link.close()
        confused = mantracourt.open_torque_sensor(
            settings("mantracourt", modem.near, scale=1.0, averaging=0.0, station=42, command="NONE"), link
        )
        with pytest.raises(DeviceError, match="does not know the command NONE"):
            confused.identify(timeout_s=1)
