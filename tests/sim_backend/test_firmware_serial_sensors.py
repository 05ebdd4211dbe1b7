"""The emulated serial sensors: what their bytes say, to whom they answer, and how finely they tell."""

from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from crccheck.crc import CrcModbus

from norton_drivers.codecs.dyn200 import PushStream
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.buses import SimulatedLine
from norton_sim.firmware.dyn200 import Dyn200Sensor
from norton_sim.firmware.serial_sensors import AsciiSensor, MantracourtSensor

MS = 1_000_000
PORT = "/tmp/sensor"
Bench = Callable[..., SimulatedBackend]
Sensor = Dyn200Sensor | AsciiSensor | MantracourtSensor


class Host:
    """The line as another program would have it."""

    def __init__(self, backend: SimulatedBackend) -> None:
        line = backend.open_serial(PORT, 115_200).line
        assert isinstance(line, SimulatedLine)
        self.line = line
        self.world = backend.world
        sensor = backend.world.devices["torque_sensor"]
        assert isinstance(sensor, Dyn200Sensor | AsciiSensor | MantracourtSensor)
        self.sensor: Sensor = sensor

    def hear(self, duration_ms: float) -> bytes:
        """All that arrives meanwhile."""
        end_ns, heard = self.world.now_ns + round(duration_ms * MS), b""
        while self.world.now_ns < end_ns:
            self.world.advance(min(self.world.now_ns + MS, end_ns))
            while piece := self.line.read(1000):
                heard += piece
        return heard

    def ask(self, question: bytes) -> bytes:
        self.line.write(question)
        return self.hear(10)


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Bench) -> Callable[..., Host]:
    def opened(driver: str, **options: object) -> Host:
        sensor = DeviceSettings("torque_sensor", driver, port=PORT, options=options)
        return Host(open_bench(replace(wiring, torque_sensor=sensor)))

    return opened


def with_crc(text: str) -> bytes:
    frame = bytes.fromhex(text)
    return frame + CrcModbus.calc(frame).to_bytes(2, "little")


# ---- DYN-200, pushing -----------------------------------------------------------------------------------------------


@pytest.fixture
def pushing(open_host: Callable[..., Host]) -> Host:
    return open_host("dyn200", mode="push", torque_per_digit=1e-3)


def test_it_pushes_a_frame_each_millisecond(pushing: Host) -> None:
    frames = PushStream().feed(pushing.hear(1000))
    assert abs(len(frames) - 997) <= 3
    digits = np.array([frame.torque_digits for frame in frames])
    # Bias 3 mN m and noise 1 mN m, in whole millinewton metres.
    assert digits.mean() == pytest.approx(3, abs=0.2)
    assert digits.std() == pytest.approx(np.hypot(1, 1 / np.sqrt(12)), rel=0.1)
    assert {frame.speed_rpm for frame in frames} == {0}


@pytest.mark.parametrize(("torque_nm", "digits"), [(-1.2344, -1234), (1000.0, 65535), (nan, 65535)])
def test_pushed_digits(pushing: Host, torque_nm: float, digits: int) -> None:
    pushing.sensor.signal.force(torque_nm)
    pushing.hear(5)
    frames = PushStream().feed(pushing.hear(50))
    assert {frame.torque_digits for frame in frames} == {digits}


def test_frozen_frames_keep_coming(pushing: Host) -> None:
    pushing.sensor.freeze()
    pushing.hear(5)
    frames = PushStream().feed(pushing.hear(50))
    assert len(frames) > 40
    assert len({frame.torque_digits for frame in frames}) == 1


# ---- DYN-200, asked -------------------------------------------------------------------------------------------------


@pytest.fixture
def asked(open_host: Callable[..., Host]) -> Host:
    host = open_host("dyn200", mode="polled", torque_per_digit=1e-3, station=5)
    host.sensor.signal.force(-0.2504)
    host.hear(5)
    return host


def test_it_answers_its_own_address_alone(asked: Host) -> None:
    assert asked.ask(with_crc("05 03 0000 0002")) == with_crc("05 03 04 FFFFFF06")
    assert asked.ask(with_crc("06 03 0000 0002")) == b""
    assert asked.ask(with_crc("00 03 0000 0002")) == b""


def test_several_numbers_at_once(asked: Host) -> None:
    assert asked.ask(with_crc("05 03 0000 0004")) == with_crc("05 03 08 FFFFFF06 00000000")
    assert asked.ask(with_crc("05 03 0008 0004")) == with_crc("05 03 08 00000003 00000000")
    assert asked.ask(with_crc("05 03 0001 0001")) == with_crc("05 03 02 FF06")


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("05 03 0100 0002", "05 83 02"),
        ("05 03 0002 0003", "05 83 02"),
        ("05 03 0000 0000", "05 83 03"),
        ("05 03 0000 000D", "05 83 03"),
        ("05 04 0000 0002", "05 84 01"),
        ("05 10 0006 0002 04 00000032", "05 90 01"),
    ],
)
def test_what_it_cannot_do_is_answered_with_an_exception(asked: Host, question: str, answer: str) -> None:
    assert asked.ask(with_crc(question)) == with_crc(answer)


def test_bytes_that_are_no_question(asked: Host) -> None:
    question = with_crc("05 03 0000 0002")
    assert asked.ask(question[:-1] + b"\0") == b""
    assert asked.ask(question[:5]) == b""
    # Silence has passed since: what was cut short is forgotten.
    assert asked.ask(question) == with_crc("05 03 04 FFFFFF06")


def test_it_takes_its_time(asked: Host) -> None:
    asked.line.write(with_crc("05 03 0000 0002"))
    # 8 bytes there, 0.5 ms of work, 9 bytes back, and twice the wire's 0.4 ± 0.1 ms.
    assert asked.hear(2.5) != with_crc("05 03 04 FFFFFF06")
    asked.line.write(with_crc("05 03 0000 0002"))
    assert asked.hear(3.5).endswith(with_crc("05 03 04 FFFFFF06"))


# ---- ASCII ----------------------------------------------------------------------------------------------------------


def test_lines_of_the_form_the_rig_names(open_host: Callable[..., Host]) -> None:
    host = open_host("ascii", scale=0.5, unit=" Nm", separator=";", field=2)
    host.sensor.signal.force(-0.30004)
    host.hear(5)
    lines = host.hear(1000).split(b"\r\n")[1:-1]
    assert set(lines) == {b"0;-000.6001 Nm"}
    assert abs(len(lines) - 498) <= 3


def test_a_line_without_a_number(open_host: Callable[..., Host]) -> None:
    host = open_host("ascii", scale=1.0, width=12)
    host.sensor.signal.force(nan)
    host.hear(5)
    assert set(host.hear(50).split(b"\r\n")[1:-1]) == {b"-OL-        "}


# ---- Mantracourt ----------------------------------------------------------------------------------------------------


@pytest.fixture
def converter(open_host: Callable[..., Host]) -> Host:
    host = open_host("mantracourt", scale=0.01, averaging=2e-3, station=42)
    host.sensor.signal.force(0.321)
    host.hear(5)
    return host


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (b"!042:SOUT?\r", b"+00032.100\r"),
        (b"!042:sout?\r", b"+00032.100\r"),
        (b"!042:VER?\r", b"+00774.000\r"),
        (b"!042:NONE?\r", b"?\r"),
        (b"!042:SOUT=1\r", b"?\r"),
        (b"!001:SOUT?\r", b""),
        (b"!000:SOUT?\r", b""),
        (b"noise\r!042:SOUT?\r", b"+00032.100\r"),
        (b"!042:SO", b""),
    ],
)
def test_questions_and_answers(converter: Host, question: bytes, answer: bytes) -> None:
    assert converter.ask(question) == answer


def test_it_clamps(converter: Host) -> None:
    for torque_nm, answer in ((1e6, b"+99999.999\r"), (-1e6, b"-99999.999\r"), (nan, b"+99999.999\r")):
        converter.sensor.signal.force(torque_nm)
        converter.hear(5)
        assert converter.ask(b"!042:SOUT?\r") == answer
