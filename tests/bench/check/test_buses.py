"""One identifier under which two devices answer: no alarm while each is itself, an alarm when one of them is two."""

import pytest

from norton_bench.check.buses import check_bus, two_rhythms
from norton_bench.check.survey import BusSurvey
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
