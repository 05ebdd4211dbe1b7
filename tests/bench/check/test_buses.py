"""One identifier under which two devices answer: no alarm while each is itself, an alarm when one of them is two."""

import pytest

from norton_bench.check.buses import check_bus, two_rhythms
from norton_bench.check.survey import BusSurvey, bits_of
from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.vesc import Packet
from norton_drivers.readings import RawFrame
from norton_drivers.registry import recognition
from norton_drivers.wiring import CanBusSettings, DeviceSettings

HOST = 254
ANSWER = protocol.arbitration_id(Packet.PROCESS_SHORT_BUFFER, HOST)  # 0x8FE
PERIOD_NS = 20_000_000  # as often as each drive is asked for its fault code
COUNT = 60
BUS = CanBusSettings("can0", "udp_multicast", "239.74.163.9")
TWO_VESCS = [DeviceSettings(role, "vesc", "can0", options={"node": n}) for role, n in (("actuator", 1), ("load", 2))]


def survey_of(*answering: tuple[int, int]) -> BusSurvey:
    """VESCs, each ``(node, when it answers within the period [ns])``; all send STATUS, too."""
    frames = [
        RawFrame(k * PERIOD_NS + phase_ns, "can0", False, bytes((node, 1, 50, 0, 0, 128, 0, 0)), ANSWER, extended=True)
        for node, phase_ns in answering
        for k in range(COUNT)
    ]
    statuses = [
        RawFrame(1_000, "can0", False, bytes(8), protocol.arbitration_id(Packet.STATUS, node), extended=True)
        for node, _ in answering
    ]
    survey = BusSurvey()
    for frame in sorted((*frames, *statuses), key=lambda frame: frame.stamp_ns):
        survey.note(frame)
    return survey


def alarms(survey: BusSurvey) -> list[str]:
    found = check_bus(BUS, survey, TWO_VESCS, recognition(), {}, COUNT * PERIOD_NS * 1e-9)
    return [str(problem) for problem in found.problems]


@pytest.mark.parametrize("phase_ns", [500_000, 3_000_000, 7_000_000, 13_000_000, 19_000_000])
def test_two_vescs_that_answer_the_same_host_are_not_one_address(phase_ns: int) -> None:
    survey = survey_of((1, 0), (2, phase_ns))
    assert two_rhythms(survey.heard[ANSWER, True].arrivals_ns)  # what gave the alarm
    assert alarms(survey) == []


@pytest.mark.parametrize("others", [(), ((2, 9_000_000),)], ids=["alone", "beside another"])
def test_two_vescs_of_one_node_are_told_by_their_answers(others: tuple[tuple[int, int], ...]) -> None:
    (alarm,) = alarms(survey_of((1, 0), (1, 700_000), *others))
    assert "two devices share the address of [actuator] (0x000008FE comes from two senders)" in alarm


# The longest frames without stuff bits, by ISO 11898-1:2015: CAN FD with 64 bytes has 29 bits at the first rate
# (extended 48), and 550 at the second, its CRC's fixed stuff bits among them.
@pytest.mark.parametrize(
    ("frame", "first", "second"),
    [
        (RawFrame(0, "c", True, bytes(8), 1), 111, 0),
        (RawFrame(0, "c", True, bytes(8), 1, extended=True), 131, 0),
        (RawFrame(0, "c", True, b"", 1, remote=True), 47, 0),
        (RawFrame(0, "c", True, bytes(64), 1, fd=True, switched=True), 29, 550),
        (RawFrame(0, "c", True, bytes(16), 1, extended=True, fd=True, switched=True), 48, 161),
        (RawFrame(0, "c", True, bytes(16), 1, fd=True), 29 + 161, 0),
    ],
)
def test_bits_of_a_frame(frame: RawFrame, first: int, second: int) -> None:
    told_first, told_second = bits_of(frame)
    assert first <= told_first <= 1.06 * first
    assert second <= told_second <= 1.06 * second


def test_the_load_of_a_bus_with_two_rates() -> None:
    survey, frame = BusSurvey(), RawFrame(0, "can0", False, bytes(32), 0x100, fd=True, switched=True)
    for _ in range(1000):
        survey.note(frame)
    bus = CanBusSettings("can0", "udp_multicast", "239.74.163.9", fd=True, data_bitrate_bit_s=5_000_000)
    assert check_bus(bus, survey, [], {}, {}, 1.0).load == pytest.approx(0.030 + 0.061, abs=0.003)
    with_one = CanBusSettings("can0", "udp_multicast", "239.74.163.9", fd=True)
    assert check_bus(with_one, survey, [], {}, {}, 1.0).load == pytest.approx(0.030 + 5 * 0.061, abs=0.01)
