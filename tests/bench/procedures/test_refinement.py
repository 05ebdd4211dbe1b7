"""Which intervals count, which are given up, and why: from stand-in estimates."""

from dataclasses import replace
from math import inf, nan

import pytest

from norton_bench.identification.expansion import KNOWN
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.refinement import Interval, Refinement, half_width, intervals_of, why_wide, widest_of


def estimate(name: str, std: float, status: Status = Status.VALID, value: float = 1.0) -> Estimate:
    return Estimate(name, value, std, "1", status)


def interval(half: float, name: str = "inertia", of_noise: float = 0.001) -> Interval:
    return Interval(name, half, of_noise, KNOWN.index("inertia"))


def after_round(log: Refinement, before: float, foreseen: float, found: float) -> Refinement:
    return replace(log, predicted={"inertia": (before, foreseen)}).judged([interval(found)])


def test_half_an_interval_is_relative_to_the_value() -> None:
    assert half_width(estimate("inertia", 0.01, value=-2.0)) == pytest.approx(0.0098)
    assert half_width(estimate("inertia", 3.0, Status.UNEXCITED)) == pytest.approx(5.88)
    assert half_width(estimate("inertia", 0.01, Status.AT_BOUND)) == inf
    assert half_width(estimate("inertia", nan, Status.RATIO_ONLY)) == inf


def test_the_widest_is_one_that_has_a_number() -> None:
    estimates = (
        estimate("inertia", 0.01),
        estimate("coulomb_torque", 0.02),
        estimate("amplifier_gain", 9.0, Status.AT_BOUND),
    )
    assert widest_of(estimates) == ("coulomb_torque", pytest.approx(0.0392))
    assert widest_of(estimates[2:]) is None


def test_intervals_know_their_place_and_what_noise_would_leave() -> None:
    of_noise = [0.001 * (1 + index) for index in range(len(KNOWN))]
    found = intervals_of((estimate("inertia", 0.01), estimate("torque_constant", 0.02)), of_noise)
    assert [each.row for each in found] == [KNOWN.index("inertia"), KNOWN.index("torque_gain")]
    assert [each.of_noise for each in found] == [pytest.approx(1.96 * 0.003), pytest.approx(1.96 * 0.001)]


def test_what_does_not_narrow_twice_running_is_set_aside() -> None:
    log = after_round(Refinement(0.01), before=0.04, foreseen=0.02, found=0.039)
    assert not log.set_aside(interval(0.039))
    log = after_round(log, before=0.039, foreseen=0.02, found=0.038)
    assert log.set_aside(interval(0.038))
    assert not log.set_aside(interval(0.038, "coulomb_torque"))


def test_what_narrows_about_as_foreseen_is_not() -> None:
    log = after_round(Refinement(0.01), before=0.04, foreseen=0.02, found=0.039)
    log = after_round(log, before=0.039, foreseen=0.02, found=0.028)
    log = after_round(log, before=0.028, foreseen=0.02, found=0.028)
    assert not log.set_aside(interval(0.028))


def test_where_little_was_foreseen_nothing_is_judged() -> None:
    log = Refinement(0.01)
    for _ in range(5):
        log = after_round(log, before=0.04, foreseen=0.039, found=0.041)
    assert not log.set_aside(interval(0.041))


def test_why_an_interval_stays_wide() -> None:
    assert why_wide(interval(0.04, "presliding_damping", 0.005)) == (
        "the interval of presliding damping, ±4 %, is limited by model error, not by noise, "
        "which alone would give ±0.5 %"
    )
    assert "does not narrow as it should" in why_wide(interval(0.04, of_noise=0.035))


def test_reasons_become_sentences() -> None:
    ended = Refinement(0.01).ended(reached=False, reasons=["time is up; still wide: inertia ±3 %"])
    assert ended.finished
    assert ended.sentences == ("Time is up; still wide: inertia ±3 %.",)
