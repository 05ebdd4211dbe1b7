"""Bota and DBC sensors: what arrives on the wire becomes readings, once each, with sign, clock and validity."""

import math
from pathlib import Path

import cantools
import pytest

from norton_drivers import bota, dbc_sensor
from norton_drivers.codecs.bota import BotaFrame
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError

SHIPPED = cantools.database.load_file(Path(dbc_sensor.__file__).parent / "dbc" / "torque-sensor.dbc")


def frame(torque_nm: float = 0.5, *, status: int = 0, timestamp_us: int = 0) -> bytes:
    return BotaFrame(status, 1.0, 2.0, 3.0, -0.25, 0.125, torque_nm, timestamp_us, 25.0).encode()


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_bota(link, device):
    return lambda direction=1, **options: bota.open_torque_sensor(
        device("torque_sensor", "bota", direction=direction, **options), link
    )


@pytest.fixture
def open_dbc(link, device):
    return lambda direction=1, **options: dbc_sensor.open_torque_sensor(
        device("torque_sensor", "dbc", direction=direction, **options), link
    )


# ---- Bota -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "torque_nm"), [("x", -0.25), ("y", 0.125), ("z", 0.5)])
@pytest.mark.parametrize("direction", [1, -1])
def test_bota_axis_and_sign(world, link, open_bota, axis, torque_nm, direction):
    sensor = open_bota(direction, axis=axis)
    world.line.arriving = frame()
    link.poll()
    (reading,) = sensor.take_torque()
    assert reading.torque_nm == direction * torque_nm
    assert (reading.sequence, reading.arrival_ns, reading.valid) == (0, world.clock.ns, True)
    assert sensor.take_torque() == []


def test_bota_frames_cut_anywhere(world, link, open_bota):
    sensor = open_bota()
    data = b"".join(frame(timestamp_us=1000 * k) for k in range(5))
    taken = []
    for byte in data:
        world.line.arriving = bytes([byte])
        link.poll()
        taken += sensor.take_torque()
    assert [reading.sequence for reading in taken] == [0, 1, 2, 3, 4]
    assert [reading.device_ns for reading in taken] == [0, 1_000_000, 2_000_000, 3_000_000, 4_000_000]


def test_botas_clock_goes_on_where_32_bits_wrap(world, link, open_bota):
    sensor = open_bota()
    stamps = [2**32 - 1000, 0, 1000, 500]  # the last a little out of order
    world.line.arriving = b"".join(frame(timestamp_us=stamp) for stamp in stamps)
    link.poll()
    first, *rest = (reading.device_ns for reading in sensor.take_torque())
    assert [stamp - first for stamp in rest] == [1_000_000, 2_000_000, 1_500_000]


@pytest.mark.parametrize(("torque_nm", "status"), [(0.5, 1), (0.5, 2), (0.5, 4), (0.5, 8), (math.nan, 0)])
def test_bota_says_when_a_reading_is_not_to_be_trusted(world, link, open_bota, torque_nm, status):
    sensor = open_bota()
    world.line.arriving = frame(torque_nm, status=status)
    link.poll()
    (reading,) = sensor.take_torque()
    assert not reading.valid


def test_bota_that_is_not_well_is_refused_in_its_own_words(world, open_bota):
    sensor = open_bota()
    world.line.arriving = frame(status=0b11000)
    with pytest.raises(DeviceError, match=r"says that its measurements are raw: .*; unknown status bits 0x0010"):
        sensor.identify()
    world.line.arriving = frame()
    assert sensor.identify().driver == "bota"


def test_bota_range_and_junk(world, link, open_bota):
    sensor = open_bota(range=2.0)
    world.line.arriving = b"junk\xaa" + bytes(40) + frame()
    link.poll()
    assert len(sensor.take_torque()) == 1
    assert (sensor.range_nm, sensor.malformed, sensor.stream.discarded_bytes) == (2.0, 1, 45)


def test_bota_range_unknown(open_bota):
    assert math.isinf(open_bota().range_nm)


def test_bota_identity_needs_a_frame(world, link, open_bota):
    sensor = open_bota()
    world.line.arriving = b"garbage"
    with pytest.raises(DeviceTimeoutError, match=r"no frame in 1 s \(7 bytes that are none\).*baud 460800"):
        sensor.identify()
    world.line.arriving = frame()
    assert sensor.identify().address == "fake"


def test_bota_axis_that_is_none(open_bota):
    with pytest.raises(WiringError, match=r"\[torque_sensor\] axis = 'w': input should be 'x', 'y' or 'z'"):
        open_bota(axis="w")


# ---- DBC ------------------------------------------------------------------------------------------------------------


def send(world, torque_nm: float, counter: int = 0, status: int = 0, **kind: bool) -> None:
    data = SHIPPED.encode_message("TorqueReading", {"Torque": torque_nm, "Counter": counter, "Status": status})
    world.bus.arrive(801, data, **kind)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("scale", [None, 0.5])
def test_dbc_scale_and_sign(world, link, open_dbc, direction, scale):
    sensor = open_dbc(direction, **({} if scale is None else {"scale": scale}))
    send(world, -0.75)
    link.poll()
    (reading,) = sensor.take_torque()
    assert reading.torque_nm == pytest.approx(-0.75 * direction * (scale or 1.0), abs=0.5e-6)
    assert (reading.device_ns, reading.valid, reading.arrival_ns) == (None, True, world.clock.ns)


def test_dbc_repeats_are_not_new_readings(world, link, open_dbc):
    sensor = open_dbc(counter="Counter")
    for counter in (7, 7, 8, 8, 8, 7):
        send(world, 0.1, counter)
    link.poll()
    assert [reading.sequence for reading in sensor.take_torque()] == [0, 1, 2]
    assert sensor.repeats == 3


def test_dbc_without_a_counter_every_frame_is_a_reading(world, link, open_dbc):
    sensor = open_dbc()
    for _ in range(3):
        send(world, 0.1, 7)
    link.poll()
    assert len(sensor.take_torque()) == 3


def test_dbc_status(world, link, open_dbc):
    sensor = open_dbc(status="Status")
    send(world, 0.1, status=0)
    send(world, 0.1, status=4)
    link.poll()
    assert [reading.valid for reading in sensor.take_torque()] == [True, False]


def test_dbc_other_frames_and_malformed_ones(world, link, open_dbc):
    sensor = open_dbc()
    world.bus.arrive(802, bytes(8))
    send(world, 0.1, extended=True)
    world.bus.arrive(801, remote=True)
    link.poll()
    assert (sensor.take_torque(), sensor.malformed) == ([], 0)
    world.bus.arrive(801, bytes(2))
    link.poll()
    assert (sensor.take_torque(), sensor.malformed) == ([], 1)


def test_dbc_identity(world, open_dbc):
    sensor = open_dbc()
    with pytest.raises(DeviceTimeoutError, match=r"can0 TorqueReading \(id 0x321\): no reading in 1 s"):
        sensor.identify()
    send(world, 0.1)
    assert sensor.identify().address == "can0 TorqueReading (id 0x321)"


@pytest.fixture
def dbc_in_millis(tmp_path):
    path = tmp_path / "sensor.dbc"
    text = (Path(dbc_sensor.__file__).parent / "dbc" / "torque-sensor.dbc").read_text()
    path.write_text(text.replace('"Nm"', '"mNm"'))
    return str(path)


def test_dbc_a_unit_is_not_guessed(world, link, open_dbc, dbc_in_millis):
    with pytest.raises(
        WiringError, match=r"\"Torque\" is in 'mNm': give its size in N\*m, for instance scale = 0\.001"
    ):
        open_dbc(dbc=dbc_in_millis)
    sensor = open_dbc(dbc=dbc_in_millis, scale=0.001)
    send(world, 500.0)
    link.poll()
    assert sensor.take_torque()[0].torque_nm == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"dbc": "no-such"}, r'dbc = "no-such" is neither a file nor one of the shipped: torque-sensor'),
        ({"dbc": __file__}, r"is not a DBC file that can be read"),
        ({"message": "Nothing"}, r'message = "Nothing" is not in torque-sensor\.dbc; it has TorqueReading'),
        ({"signal": "Force"}, r'signal = "Force" is not a signal of TorqueReading; it has Torque, Counter, Status'),
        ({"counter": "Count"}, r'counter = "Count" is not a signal of TorqueReading'),
        ({"status": "State"}, r'status = "State" is not a signal of TorqueReading'),
    ],
)
def test_dbc_wrong_options_are_told_with_the_mend(open_dbc, options, sentence):
    with pytest.raises(WiringError, match=sentence):
        open_dbc(**options)
