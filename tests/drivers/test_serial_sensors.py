"""DYN-200, ASCII and Mantracourt sensors against scripted ones: what is asked, when, and what is made of answers."""

import math
from itertools import pairwise

import pytest

from norton_drivers import ascii_lines, dyn200, mantracourt
from norton_drivers.codecs.dyn200 import FRAMES_TO_LOCK, PushFrame, number_value
from norton_drivers.codecs.modbus import ReadAnswer, ReadRequest, Refusal
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError

MS = 1_000_000
DELAY_NS = 2_500_000
BYTE_NS = 10e9 / 115_200


class ScriptedStation:
    """Answers every question ``delay_ns()`` after it, with what ``answer(question)`` gives; None is no answer."""

    def __init__(self, world, answer, delay_ns=lambda: DELAY_NS) -> None:
        self.line, self.clock = world.line, world.clock
        self.answer = answer
        self.delay_ns = delay_ns
        self.asked_ns: list[int] = []
        self.due: list[tuple[int, bytes]] = []
        world.line.peer = self.receive
        world.clock.alarms.append(self.tick)

    def receive(self, question: bytes) -> None:
        self.asked_ns.append(self.clock.ns)
        if (answer := self.answer(question)) is not None:
            self.due.append((self.clock.ns + self.delay_ns(), answer))
            self.due.sort()

    def tick(self, now_ns: int) -> None:
        while self.due and self.due[0][0] <= now_ns:
            self.line.arriving += self.due.pop(0)[1]


def numbers(registers: dict[int, int]):
    """A Modbus station 1 with numbers at these registers; a refusal elsewhere."""

    def answer(question: bytes) -> bytes:
        request = ReadRequest.decode(question)
        asked = range(request.register, request.register + request.count, 2)
        if not all(register in registers for register in asked):
            return Refusal(1, 2).encode()
        return ReadAnswer(1, b"".join(number_value(registers[register]) for register in asked)).encode()

    return answer


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_polled(link, device):
    def opened(direction: int = 1, **options: object):
        options = {"mode": "polled", "torque_per_digit": 1e-3, **options}
        return dyn200.open_torque_sensor(device("torque_sensor", "dyn200", direction=direction, **options), link)

    return opened


@pytest.fixture
def open_push(link, device):
    def opened(direction: int = 1, **options: object):
        options = {"mode": "push", "torque_per_digit": 1e-3, **options}
        return dyn200.open_torque_sensor(device("torque_sensor", "dyn200", direction=direction, **options), link)

    return opened


@pytest.fixture
def open_ascii(link, device):
    def opened(direction: int = 1, **options: object):
        options = {"scale": 1.0, **options}
        return ascii_lines.open_torque_sensor(device("torque_sensor", "ascii", direction=direction, **options), link)

    return opened


@pytest.fixture
def open_mantracourt(link, device):
    def opened(direction: int = 1, **options: object):
        options = {"scale": 0.01, "averaging": 2e-3, **options}
        return mantracourt.open_torque_sensor(
            device("torque_sensor", "mantracourt", direction=direction, **options), link
        )

    return opened


def wait_ms(link, duration_ms: int) -> None:
    for _ in range(duration_ms):
        link.wait(MS)


# ---- DYN-200, asked -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
def test_polled_scale_sign_and_stamps(world, link, open_polled, direction):
    station = ScriptedStation(world, numbers({0: -1234}))
    sensor = open_polled(direction)
    wait_ms(link, 30)
    readings = sensor.take_torque()
    assert [reading.torque_nm for reading in readings] == [pytest.approx(-1.234 * direction)] * len(readings)
    assert [reading.sequence for reading in readings] == list(range(len(readings)))
    # The sensor measured somewhere between question and answer: both instants are told.
    assert [reading.device_ns for reading in readings] == station.asked_ns[: len(readings)]
    assert [r.arrival_ns - r.device_ns for r in readings] == [3 * MS] * len(readings)


def test_one_question_at_a_time_and_silence_between(world, link, open_polled):
    station = ScriptedStation(world, numbers({0: 5}))
    open_polled()
    wait_ms(link, 100)
    # Asked at 0, answered at 2.5, read at 3; 1.75 ms of silence, as Modbus asks for, end before the tick at 5.
    assert {b - a for a, b in pairwise(station.asked_ns)} == {5 * MS}
    assert world.line.sent[0] == bytes.fromhex("01 03 00 00 00 02 C4 0B")


def test_a_sensor_that_needs_no_silence_is_asked_as_soon_as_it_has_answered(world, link, open_polled):
    station = ScriptedStation(world, numbers({0: 5}))
    open_polled(silence=0.0)
    wait_ms(link, 100)
    assert {b - a for a, b in pairwise(station.asked_ns)} == {3 * MS}


def test_a_lost_answer_ends_nothing(world, link, open_polled):
    station = ScriptedStation(world, numbers({0: 5}))
    sensor = open_polled(timeout=0.02)
    wait_ms(link, 20)
    whole, station.answer = station.answer, lambda _question: None
    wait_ms(link, 50)
    station.answer = whole
    sensor.take_torque()
    wait_ms(link, 50)
    assert sensor.questions.unanswered == 3
    assert len(sensor.take_torque()) >= 4


def test_an_answer_that_comes_after_its_question_was_given_up_shifts_no_others(world, link, open_polled):
    late = iter([23 * MS])
    ScriptedStation(world, numbers({0: 5}), lambda: next(late, DELAY_NS))
    sensor = open_polled(timeout=0.02, silence=0.0)
    wait_ms(link, 120)
    first, *others = (reading.arrival_ns - reading.device_ns for reading in sensor.take_torque())
    assert sensor.questions.unanswered == 1
    # The late one is taken for the second question's; the second one's own then found nobody waiting.
    assert first == 2 * MS
    assert set(others) == {3 * MS}
    assert len(others) > 20


def test_an_answer_that_waited_while_this_computer_stood_still_is_one(world, link, open_polled):
    station = ScriptedStation(world, numbers({0: 5}))
    sensor = open_polled(timeout=0.02)
    link.poll()
    world.clock.wait_until_ns(world.clock.ns + 200 * MS)
    link.poll()
    (reading,) = sensor.take_torque()
    assert (reading.device_ns, sensor.questions.unanswered) == (station.asked_ns[0], 0)


def test_an_answer_cut_in_two_and_an_echo(world, link, open_polled):
    answer = ReadAnswer(1, number_value(7)).encode()
    sensor = open_polled()
    link.poll()
    question = world.line.sent[0]
    for piece in (question + answer[:4], answer[4:]):
        assert sensor.take_torque() == []
        world.line.arriving = piece
        link.poll()
    (reading,) = sensor.take_torque()
    assert reading.torque_nm == pytest.approx(7e-3)
    assert sensor.stream.discarded_bytes == len(question)


def test_beyond_its_range_it_measures_nothing(world, link, open_polled):
    ScriptedStation(world, numbers({0: 2001}))
    sensor = open_polled(range=2.0)
    wait_ms(link, 5)
    assert [reading.valid for reading in sensor.take_torque()] == [False]
    assert sensor.range_nm == 2.0


def test_polled_identity(world, open_polled):
    ScriptedStation(world, numbers({0: 5, 8: 3, 10: 0}))
    identity = open_polled().identify()
    assert (identity.driver, identity.address, identity.hardware) == ("dyn200", "fake station 1", "3 decimals")


def test_a_sensor_without_a_register_for_its_decimals(world, open_polled):
    ScriptedStation(world, numbers({0: 5}))
    assert open_polled().identify().hardware == ""


@pytest.mark.parametrize(
    ("options", "decimals", "agree"),
    [
        ({"torque_per_digit": 1e-2}, 3, False),
        ({"torque_per_digit": 1e-3}, 3, True),
        ({"torque_per_digit": 1e-4, "decimals": 1}, 1, True),  # in mN*m
        ({"torque_per_digit": 1e-4, "decimals": 2}, 1, False),
        ({"torque_per_digit": 9.81e-5}, 1, True),  # in gf*cm: nothing can be compared
    ],
)
def test_decimals_that_do_not_go_with_the_scale_are_told(world, open_polled, options, decimals, agree):
    ScriptedStation(world, numbers({0: 5, 8: decimals, 10: 0}))
    sensor = open_polled(**options)
    if agree:
        assert sensor.identify().hardware == f"{decimals} decimals"
        return
    with pytest.raises(DeviceError, match=rf"shows torque with {decimals} decimals, but .*write decimals = {decimals}"):
        sensor.identify()


def test_after_the_decimals_torque_is_asked_for_again(world, link, open_polled):
    ScriptedStation(world, numbers({0: 5, 8: 3, 10: 0}))
    sensor = open_polled()
    sensor.identify()
    sensor.take_torque()
    wait_ms(link, 20)
    assert len(sensor.take_torque()) >= 3


def test_a_refusal_is_told_in_words(world, open_polled):
    ScriptedStation(world, numbers({}))
    with pytest.raises(DeviceError, match=r"refuses to tell its torque \(exception 02, illegal data address\)"):
        open_polled().identify()


def test_nobody_there(world, open_polled):
    world.line.arriving = b"noise"
    with pytest.raises(DeviceTimeoutError, match=r"station 7 on fake: no answer in 0\.2 s .*5 bytes.*mode = \"push\""):
        open_polled(station=7).identify(timeout_s=0.2)


def test_a_lost_port_is_told(world, link, open_polled):
    open_polled()
    world.line.peer = lambda _data: (_ for _ in ()).throw(OSError("unplugged"))
    with pytest.raises(ConnectionFailedError, match="port fake: cannot write"):
        link.poll()


# ---- DYN-200, pushing -----------------------------------------------------------------------------------------------


def pushed(*torques: int) -> bytes:
    return b"".join(PushFrame(torque, 60).encode() for torque in torques)


@pytest.mark.parametrize("direction", [1, -1])
def test_push_scale_sign_and_stamps(world, link, open_push, direction):
    sensor = open_push(direction)
    world.line.arriving = pushed(*range(FRAMES_TO_LOCK)) + pushed(-500, 250) + b"\0\0"
    link.poll()
    readings = sensor.take_torque()
    assert [reading.torque_nm for reading in readings] == pytest.approx([-0.5 * direction, 0.25 * direction])
    assert [r.device_ns for r in readings] == [None, None]
    ages_ns = [world.clock.ns - reading.arrival_ns for reading in readings]
    assert ages_ns == pytest.approx([8 * BYTE_NS, 2 * BYTE_NS], abs=1)


def test_push_identity_and_junk(world, link, open_push):
    sensor = open_push()
    world.line.arriving = bytes(100)
    with pytest.raises(DeviceTimeoutError, match=r"no frame in 0\.1 s \(9\d bytes .*active upload.*mode = \"polled\""):
        sensor.identify(timeout_s=0.1)
    world.line.arriving = pushed(1, 2, 3, 4, 5, 6)
    assert sensor.identify().address == "fake"
    world.line.arriving = pushed(1, 2)[:-1] + b"\0"
    link.poll()
    assert sensor.malformed == 1


# ---- ASCII lines ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
def test_ascii_scale_sign_and_stamps(world, link, open_ascii, direction):
    sensor = open_ascii(direction, scale=0.001, unit="mNm")
    world.line.arriving = b"00 mNm\r\n0 mNm\r\n-1500.0 mNm\r\n250 mNm\r\n+1"
    link.poll()
    readings = sensor.take_torque()
    assert [reading.torque_nm for reading in readings] == pytest.approx([-1.5 * direction, 0.25 * direction])
    ages_ns = [world.clock.ns - reading.arrival_ns for reading in readings]
    # What came after the end of each: LF, the nine bytes of the next line, and the two that have begun another.
    assert ages_ns == pytest.approx([12 * BYTE_NS, 3 * BYTE_NS], abs=1)


def test_ascii_lines_that_are_none(world, link, open_ascii):
    sensor = open_ascii(width=6, range=2.0)
    world.line.arriving = b"\r+0.000\r+1.000\r+10.00\r+3.000\r1.000\r+1,000\r" + b"9" * 200 + b"\r-0.400\r-0.500\r"
    link.poll()
    readings = sensor.take_torque()
    assert [(reading.torque_nm, reading.valid) for reading in readings] == [
        (1.0, True),
        (10.0, False),
        (3.0, False),
        (-0.5, True),
    ]
    assert (sensor.lines.numbers.garbled, sensor.lines.stream.overlong, sensor.malformed) == (2, 1, 3)


def test_a_number_behind_a_line_that_is_none_is_not_believed(world, link, open_ascii):
    sensor = open_ascii()
    world.line.arriving = b"\n1.0\n1.1\nx\n5\n\xff\n6\n1.2\n1.3\n"
    link.poll()
    assert [reading.torque_nm for reading in sensor.take_torque()] == [1.1, 1.2, 1.3]
    assert sensor.lines.numbers.garbled == 2


def test_ascii_fields(world, link, open_ascii):
    sensor = open_ascii(separator=",", field=2, unit="Nm")
    world.line.arriving = b"\n7,0 Nm,1200\n7,-0.25 Nm,1200\n7,0.5,1200\n"
    link.poll()
    assert [reading.torque_nm for reading in sensor.take_torque()] == [-0.25]
    assert sensor.lines.numbers.garbled == 1


def test_ascii_identity(world, open_ascii):
    sensor = open_ascii()
    world.line.arriving = b"\r\n1.0 lbf in\r\n"
    with pytest.raises(
        DeviceTimeoutError, match=r"no number in 0\.1 s \(1 lines that are none, the last '1\.0 lbf in'"
    ):
        sensor.identify(timeout_s=0.1)
    world.line.arriving = b"1.0\r\n1.1\r\n"
    assert sensor.identify().address == "fake"


# ---- Mantracourt ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
def test_mantracourt_scale_sign_and_stamps(world, link, open_mantracourt, direction):
    station = ScriptedStation(world, lambda _question: b"+00032.100\r")
    sensor = open_mantracourt(direction, width=10)
    wait_ms(link, 30)
    readings = sensor.take_torque()
    assert len(readings) >= 8
    assert [reading.torque_nm for reading in readings] == [pytest.approx(0.321 * direction)] * len(readings)
    assert [reading.device_ns for reading in readings] == station.asked_ns[1 : len(readings) + 1]
    assert {b - a for a, b in pairwise(station.asked_ns)} == {3 * MS}
    assert set(world.line.sent) == {b"!001:SOUT?\r"}


def test_mantracourt_hears_itself_and_loses_characters(world, link, open_mantracourt):
    answers = iter([b"+00031.000\r", b"!001:SOUT?\r+00032.100\r", b"0032.100\r", b"+0032.100\r", b"+00033.000\r"])
    ScriptedStation(world, lambda _question: next(answers, b"+00034.000\r"))
    sensor = open_mantracourt(width=10, timeout=0.01)
    wait_ms(link, 60)
    torques_nm = [reading.torque_nm for reading in sensor.take_torque()]
    assert torques_nm[:3] == pytest.approx([0.321, 0.34, 0.34])
    assert (sensor.numbers.garbled, sensor.questions.unanswered, sensor.malformed) == (2, 2, 2)


def test_mantracourt_identity(world, open_mantracourt):
    ScriptedStation(world, lambda question: b"+1.0\r" if question == b"!042:SYS?\r" else None)
    assert open_mantracourt(station=42, command="SYS").identify().address == "fake station 042"


def test_mantracourt_at_another_station(world, open_mantracourt):
    ScriptedStation(world, lambda question: b"+1.0\r" if question == b"!042:SOUT?\r" else None)
    with pytest.raises(DeviceTimeoutError, match=r"station 007 on fake: no answer in 0\.1 s \(3 questions"):
        open_mantracourt(station=7).identify(timeout_s=0.1)


def test_mantracourt_that_does_not_understand(world, open_mantracourt):
    ScriptedStation(world, lambda _question: b"?\r")
    with pytest.raises(DeviceError, match="does not know the command SOUT; correct command"):
        open_mantracourt().identify()


def test_an_answer_too_late_is_no_reading(world, link, open_mantracourt):
    sensor = open_mantracourt()
    world.line.arriving = b"+1.0\r"  # before anything was asked
    link.serial_ports["fake"].poll()
    assert sensor.take_torque() == []


# ---- Options --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("driver", "options", "sentence"),
    [
        (dyn200, {"torque_per_digit": 1e-3}, r'needs mode: "polled" asks by Modbus RTU'),
        (dyn200, {"mode": "push"}, r"needs torque_per_digit: what one digit of its torque is worth"),
        (dyn200, {"mode": "pull", "torque_per_digit": 1.0}, r"mode = 'pull': input should be 'polled' or 'push'"),
        (dyn200, {"mode": "push", "torque_per_digit": 0.0}, r"torque_per_digit = 0\.0: .*greater than 0"),
        (dyn200, {"mode": "polled", "torque_per_digit": 1.0, "station": 0}, r"station = 0: .*its Modbus address"),
        (ascii_lines, {}, r"needs scale: N\*m per unit of the number"),
        (ascii_lines, {"scale": 1.0, "field": 0}, r"field = 0: .*counted from 1"),
        (mantracourt, {"averaging": 0.002}, r"needs scale: N\*m per unit of its output"),
        (mantracourt, {"scale": 1.0}, r"needs averaging: how old its last measurement may be when it is asked"),
        (mantracourt, {"scale": 1.0, "averaging": 0.2}, r"averaging = 0\.2: .*less than or equal to 0\.05"),
        (
            mantracourt,
            {"scale": 1.0, "averaging": 0, "station": 0},
            r"station = 0: station 000 is all stations at once, and none",
        ),
        (mantracourt, {"scale": 1.0, "averaging": 0, "station": 1000}, r"station = 1000: .*1 to 999"),
        (mantracourt, {"scale": 1.0, "averaging": 0, "command": "sout"}, r"command = 'sout': a command is one to four"),
    ],
)
def test_wrong_options_are_one_sentence_with_the_place(link, device, driver, options, sentence):
    with pytest.raises(WiringError, match=sentence) as caught:
        driver.open_torque_sensor(device("torque_sensor", "x", **options), link)
    assert "\n" not in str(caught.value)


def test_ranges_unknown(open_polled, open_push):
    assert math.isinf(open_push().range_nm)
    assert math.isinf(open_polled().range_nm)
