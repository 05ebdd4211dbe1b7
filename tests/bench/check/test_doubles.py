"""Two devices at one address, told from one device in all its moods."""

import numpy as np
import pytest

from norton_bench.check.buses import answered_twice, contradictory, two_rhythms
from norton_bench.check.survey import BusSurvey, Survey
from norton_drivers.readings import ERROR_FRAME, RawFrame
from norton_drivers.registry import answers_remotely

PERIOD_NS = 100_000_000


def rhythm(count: int, phase: float, *, ppm: float = 0.0, jitter_ns: float = 0.0, seed: int = 0) -> list[float]:
    noise = np.random.default_rng(seed).uniform(-jitter_ns, jitter_ns, count)
    return [PERIOD_NS * (1 + ppm * 1e-6) * (k + phase) + late for k, late in enumerate(noise)]


@pytest.mark.parametrize("phase", [0.0, 0.02, 0.2, 0.4, 0.7, 0.98])
def test_two_heartbeats_of_one_period_are_two_devices(phase: float) -> None:
    one, other = rhythm(10, 0.0, ppm=40, jitter_ns=2e6), rhythm(10, phase, ppm=-30, jitter_ns=2e6, seed=1)
    assert two_rhythms(sorted([*one, *other]))


@pytest.mark.parametrize(
    "arrivals",
    [
        rhythm(20, 0.0),
        rhythm(20, 0.0, jitter_ns=5e6),
        rhythm(20, 0.0, jitter_ns=20e6, seed=3),
        rhythm(5, 0.3),
        [k * 1e6 for k in range(1000)],
        [8e6 * (k // 8) + 1e3 * (k % 8) for k in range(1000)],  # an adapter that hands frames over in bunches
        np.cumsum(np.random.default_rng(4).exponential(1e8, 30)).tolist(),
        [],
    ],
)
def test_one_sender_is_not_taken_for_two(arrivals: list[float]) -> None:
    assert not two_rhythms(arrivals)


def at_rest(bias: float, noise: float, count: int = 500, seed: int = 0) -> np.ndarray:
    return bias + noise * np.random.default_rng(seed).standard_normal(count)


def test_readings_of_two_devices_contradict_each_other() -> None:
    one, other = at_rest(0.2, 1e-3), at_rest(-0.1, 1e-3, seed=1)
    assert contradictory(np.column_stack([one, other]).ravel().tolist())
    assert contradictory([0.25, 7.5] * 100)


@pytest.mark.parametrize(
    "readings",
    [
        at_rest(0.3, 1e-3),
        np.zeros(500),
        np.cumsum(at_rest(0.01, 1e-3)),  # a shaft that creeps
        np.round(at_rest(0.5, 0.3)),  # a last bit that flickers
        np.tile([0.0, 0.0, 1.0, 1.0], 100),
        np.full(500, np.nan),
        [0.25, 7.5] * 5,
    ],
)
def test_one_devices_readings_do_not(readings: np.ndarray) -> None:
    assert not contradictory(list(readings))


def survey_of(answers_ns: list[list[int]]) -> BusSurvey:
    """One question a second, each with answers after so many nanoseconds."""
    survey = BusSurvey()
    for number, delays in enumerate(answers_ns):
        at_ns = number * 1_000_000_000
        survey.note(RawFrame(at_ns, "can0", True, b"", 0x20, remote=True))
        for delay_ns in delays:
            survey.note(RawFrame(at_ns + delay_ns, "can0", False, bytes(8), 0x20))
    return survey


@pytest.mark.parametrize(
    ("answers_ns", "twice"),
    [
        ([[400_000, 900_000]], True),
        ([[400_000, 500_000], [1_000_000, 1_200_000]], True),
        ([[400_000]], False),
        ([[]], False),
        ([[400_000, 500_000], [300_000]], False),
        ([[400_000, 200_000_000]], False),  # what comes much later answers something else
    ],
)
def test_a_question_with_two_answers(answers_ns: list[list[int]], twice: bool) -> None:
    survey = survey_of(answers_ns)
    found = answered_twice(survey, [answers_remotely])
    assert [(frame.arbitration_id, frame.sent) for frame in found] == ([(0x20, False)] if twice else [])
    assert answered_twice(survey, []) == []


def test_error_frames_are_nobodys_messages() -> None:
    survey = Survey()
    survey.note(RawFrame(1, "can0", False, bytes(8), ERROR_FRAME | 0x20))
    survey.note(RawFrame(2, "/dev/ttyUSB0", False, b"abc"))
    survey.note(RawFrame(3, "can0", False, bytes(8), 0x29))
    assert (survey.buses["can0"].standard_ids(), survey.buses["can0"].frames) == ({0x29}, 1)
    assert {port: line.bytes_heard for port, line in survey.lines.items()} == {"/dev/ttyUSB0": 3}
