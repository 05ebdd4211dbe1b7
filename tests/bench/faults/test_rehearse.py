"""Faults on a whole session: those of the short round, and that what is true is what decides."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.faults.campaign import cases
from norton_bench.faults.case import Case, CaseResult, Expected, Verdict
from norton_bench.faults.rehearse import Prepared, prepare, rehearse
from norton_bench.rig.load import load_rig
from norton_bench.sample import Alignment
from tests.bench.half_rate import half_rate

RIGS = Path(__file__).parents[3] / "rigs"
RIG = half_rate("sim-odrive")
QUICK = [case for case in cases(RIG) if case.quick]
RIDE = Expected.RIDE


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    return prepare(RIG)


def named(name: str, on: str) -> Case:
    (found,) = [case for case in cases(RIG) if (case.name, case.on) == (name, on)]
    return found


@pytest.fixture(scope="module")
def outcome_of(prepared: Prepared) -> Callable[[str, str], CaseResult]:
    """The outcome of a case by its name and place; each is rehearsed once."""
    return cache(lambda name, on: rehearse(prepared, named(name, on)))


def assert_safe(outcome: CaseResult) -> None:
    assert outcome.verdict.safe, outcome
    assert outcome.drives == {"actuator": "idle", "load": "idle"}
    if outcome.verdict is Verdict.STOPPED:
        assert outcome.off_s is not None
        assert outcome.off_s <= outcome.allowed_s == pytest.approx(0.3 + 2 * RIG.tick_s)
        assert outcome.guard
    else:
        assert outcome.peak.torque_nm <= RIG.limits.torque_nm
        assert outcome.peak.velocity_rad_s <= RIG.limits.velocity_rad_s


@pytest.mark.long
@pytest.mark.parametrize("case", QUICK, ids=lambda case: f"{case.name} on {case.on}")
def test_the_short_round_ends_safely(outcome_of: Callable[[str, str], CaseResult], case: Case) -> None:
    outcome = outcome_of(case.name, case.on)
    assert_safe(outcome)
    assert (outcome.verdict is Verdict.STOPPED) == (case.expected is Expected.STOP)
    if "count" in case.table:
        assert outcome.hits == case.table["count"]


@pytest.mark.parametrize(
    ("name", "on", "words", "within_s"),
    [
        ("silent", "actuator", "actuator encoder: silent for", 0.105),
        ("adapter unplugged", "can0", "bus can0: lost", 2 * RIG.tick_s),
        ("adapter unplugged", "torque_sensor", "port socket://localhost:7641: lost", 2 * RIG.tick_s),
        ("frames late by 200 ms", "can0", "silent for", 0.105),
        ("undervoltage", "load", "load drive: left its torque loop (fault: bus voltage too low", 0.105),
        ("host stalls for long", "bench", "the loop stood still for 1998 ms", 2.01),  # the whole ticks within 2 s
        ("reading frozen", "torque_sensor", "as no living sensor does", 0.1),
        ("bias jumps", "torque_sensor", "port torque: ", 0.2),
        ("sign flips", "actuator", "they turn opposite ways", 0.05),
        ("reading frozen", "load", "the load's encoder stands still", 0.05),
        ("coupling breaks", "bench", "coupling: actuator and load have turned|load velocity: ", 0.1),
    ],
)
def test_each_is_noticed_by_the_guard_that_is_there_for_it(
    outcome_of: Callable[[str, str], CaseResult], name: str, on: str, words: str, within_s: float
) -> None:
    outcome = outcome_of(name, on)
    assert_safe(outcome)
    assert any(each in outcome.guard for each in words.split("|"))
    assert outcome.detected_s is not None
    assert outcome.detected_s <= within_s


@pytest.fixture(scope="module")
def elastic() -> Prepared:
    return prepare(half_rate("sim-series-elastic"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "on", "words"),
    [
        ("sign flips", "torque_sensor", "check the torque sensor's zero, sign and scale, the load drive"),
        ("command runs away", "actuator", "actuator drive: its current is"),
        ("shaft stuck", "actuator", "the encoder is stuck, or the shaft is held"),
        ("one frame lost", "actuator", ""),
    ],
)
def test_without_a_law_of_the_actuator_it_ends_as_safely(elastic: Prepared, name: str, on: str, words: str) -> None:
    outcome = rehearse(elastic, named(name, on))
    assert outcome.verdict.safe
    assert words in outcome.guard
    assert (outcome.verdict is Verdict.STOPPED) == bool(words)
    assert outcome.drives == {"actuator": "idle", "load": "idle"}


def test_what_was_ridden_through_is_shown_to_have_been_there(outcome_of: Callable[[str, str], CaseResult]) -> None:
    outcome = outcome_of("messages corrupted", "torque_sensor")
    assert outcome.verdict is Verdict.RIDDEN_THROUGH
    assert "[torque_sensor]: messages that could not be decoded, 3 times" in outcome.counted
    assert "3 hit on their way" in outcome.evidence
    caught = outcome_of("frames corrupted, check fails", "can0")
    assert "bus can0: bus error, 50 times" in caught.evidence


def test_a_fault_that_nobody_notices_is_told_so(prepared: Prepared) -> None:
    """A bias so small that it is within the sensor's own noise, called one that must be noticed."""
    outcome = rehearse(prepared, Case("hidden", {"kind": "bias-jump", "on": "torque_sensor", "by": "0.1 mN*m"}))
    assert outcome.verdict is Verdict.NOT_DETECTED
    assert (outcome.guard, outcome.detected_s) == ("", None)


@pytest.mark.long
@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            {"kind": "drop", "on": "load", "count": 5, "towards": "device", "share": "0.0001 %"},
            "the fault hit no frame",
        ),
        ({"kind": "dropout", "on": "load", "at": "60 s"}, "the session ended before the fault"),
        ({"kind": "dropout", "on": "can9"}, '"can9" is no place for dropout'),
    ],
)
def test_a_case_that_comes_to_nothing_has_failed(prepared: Prepared, table: dict[str, object], words: str) -> None:
    outcome = rehearse(prepared, Case("nothing", table, RIDE))
    assert outcome.verdict is Verdict.FAILED
    assert words in outcome.guard


def test_a_program_that_stumbles_over_a_fault_is_told_so(prepared: Prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    def stumble(*_arguments: object) -> None:
        raise TypeError("a fault of its own")

    monkeypatch.setattr(Alignment, "update", stumble)
    outcome = rehearse(prepared, named("one frame lost", "load"))
    assert outcome.verdict is Verdict.FAILED
    assert outcome.guard == "the program itself failed (TypeError: a fault of its own)"


def test_a_rig_that_cannot_move_its_shaft_is_refused() -> None:
    with pytest.raises(RigError, match="needs a load drive"):
        prepare(load_rig(RIGS / "sim-free-shaft.toml"))
