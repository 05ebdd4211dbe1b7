"""Faults put into a sound log: each is named, and none gives a confident wrong number."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from norton_bench.errors import BenchError
from norton_bench.logs.results import LogFit
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import FREE, LOADED, Columns, Machine, estimate, fit_of

TRUE = Machine(duration_s=12.0, rate_hz=250.0)
VALUES = {"inertia": TRUE.inertia, "viscous_damping": TRUE.damping, "coulomb_torque": TRUE.coulomb}
# What may be wrong in a number that is called valid, relative and in deviations.
RELATIVE, DEVIATIONS = 0.03, 4.0
BOTH = FREE.replace("command =", 'velocity = { name = "w", unit = "rad/s" }\ncommand =')
GOAL = FREE.replace("command =", 'goal = { name = "goal", unit = "rad" }\ncommand =')

Fault = Callable[[Columns], Columns]


def confident_errors(fit: LogFit) -> list[str]:
    """The estimates that are called valid and are not what is true."""
    wrong = []
    for name, true in VALUES.items():
        found = estimate(fit, name)
        if found.status is Status.VALID and abs(found.value - true) > RELATIVE * true + DEVIATIONS * found.std:
            wrong.append(f"{name} {found.value} ± {found.std}")
    return wrong


def at(columns: Columns, name: str, values: np.ndarray) -> Columns:
    return columns | {name: values}


def swap(first: str, second: str) -> Fault:
    return lambda columns: columns | {first: columns[second], second: columns[first]}


def with_gap(columns: Columns) -> Columns:
    keep = (columns["t"] < 5.0) | (columns["t"] > 6.3)
    return {name: values[keep] for name, values in columns.items()}


def lost_rows(columns: Columns) -> Columns:
    """Rows are missing, and the clock does not tell."""
    short = with_gap(columns)
    return short | {"t": columns["t"][: len(short["t"])]}


def missing(name: str, *, block: bool) -> Fault:
    def fault(columns: Columns) -> Columns:
        rows = np.arange(700, 1000) if block else np.random.default_rng(5).choice(3000, 300, replace=False)
        values = columns[name].copy()
        values[rows] = np.nan
        return at(columns, name, values)

    return fault


def jump(seconds: float) -> Fault:
    return lambda columns: at(columns, "t", columns["t"] + seconds * (columns["t"] > 4.0))


def clipped(name: str, share: float) -> Fault:
    def fault(columns: Columns) -> Columns:
        end = share * np.max(np.abs(columns[name]))
        return at(columns, name, np.clip(columns[name], -end, end))

    return fault


def frozen(name: str) -> Fault:
    def fault(columns: Columns) -> Columns:
        values = columns[name].copy()
        values[1000:1500] = values[1000]
        return at(columns, name, values)

    return fault


def held(name: str) -> Fault:
    return lambda columns: at(columns, name, np.repeat(columns[name][::5], 5)[: columns["t"].size])


def turned(name: str) -> Fault:
    return lambda columns: at(columns, name, -columns[name])


def repeated(columns: Columns) -> Columns:
    rows = np.sort(np.concatenate([np.arange(3000), np.arange(1000, 1040)]))
    return {name: values[rows] for name, values in columns.items()}


def constant(name: str, value: float) -> Fault:
    return lambda columns: at(columns, name, np.full(columns["t"].size, value))


# Left as usable: the fault is named, and what is called valid is right.
NAMED: dict[str, tuple[str, Fault, str]] = {
    "missing numbers": (FREE, missing("q", block=False), "position holds no number in 300 of 3000 rows"),
    "a missing part": (FREE, missing("u", block=True), "command holds no number in 300 of 3000 rows"),
    "a gap": (FREE, with_gap, "gaps or jumps of the clock, the longest of 1.3"),
    "a clock that jumps ahead": (FREE, jump(2.0), "gaps or jumps of the clock, the longest of 2"),
    "rows that are lost": (FREE, lost_rows, "position leaps 1 times"),
    "rows twice": (FREE, repeated, "40 of 3040 rows have the same time as the row before"),
    "a saturated torque": (LOADED, clipped("tau", 0.6), "exertion is saturated"),
    "a saturated encoder": (FREE, clipped("q", 0.7), "position is saturated"),
    "a frozen torque": (LOADED, frozen("tau"), "exertion is frozen"),
    "a frozen encoder": (FREE, frozen("q"), "position is frozen"),
    "a held encoder": (FREE, held("q"), "a sensor was read in every 5. row only"),
}
# Not to be used: every estimate is doubtful, and the reason is said.
DOUBTED: dict[str, tuple[str, Fault, str]] = {
    "a command turned round": (FREE, turned("u"), "the signs of command and motion do not agree"),
    "a motion turned round": (FREE, turned("q"), "the signs of command and motion do not agree"),
    "a torque turned round": (LOADED, turned("tau"), "sign = -1"),
    "position for command": (FREE, swap("q", "u"), "position and command seem to be swapped"),
    "position for velocity": (BOTH, swap("q", "w"), "position and velocity seem to be swapped"),
    "command for torque": (LOADED, swap("u2", "tau"), "command and exertion seem to be swapped"),
    "velocity of another scale": (BOTH, lambda columns: at(columns, "w", columns["w"] * 60), "velocity is 60 times"),
    "velocity turned round": (BOTH, turned("w"), "velocity is -1 times"),
    "goal for position": (GOAL, swap("q", "goal"), "ahead of its goal"),
    "noise for a command": (
        FREE,
        lambda columns: at(columns, "u", np.random.default_rng(7).standard_normal(3000)),
        "of the exertion unexplained",
    ),
}
# Refused.
REFUSED: dict[str, tuple[str, Fault, str]] = {
    "a clock that jumps back": (FREE, jump(-2.0), "time runs backwards after row 1001"),
    "time for position": (FREE, swap("t", "q"), "that column is no clock"),
    "a constant position": (FREE, constant("q", 1.5), "position is constant (1.5)"),
    "a constant command": (FREE, constant("u", 0.0), "command is constant (0)"),
    "a constant torque": (LOADED, constant("tau", 0.0), "exertion is constant (0)"),
    "no clock": (FREE, constant("t", 3.0), "rows have the same time as the row before"),
    "nothing but holes": (FREE, constant("q", float("nan")), "position holds no number in 3000 of 3000 rows"),
}


def log() -> Columns:
    columns = TRUE.log()
    # The goal of a loop that follows it with a lag of 30 ms.
    columns["goal"] = TRUE.motion(columns["t"] + 0.03)[0]
    return columns


@pytest.mark.parametrize("name", NAMED)
def test_a_fault_that_can_be_left_out_is_named(tmp_path: Path, name: str) -> None:
    text, fault, said = NAMED[name]
    fit = fit_of(tmp_path, fault(log()), text)
    assert any(said in sentence for sentence in fit.verdict), fit.verdict
    assert confident_errors(fit) == []
    assert not fit.doubtful


@pytest.mark.long
@pytest.mark.parametrize("name", DOUBTED)
def test_a_fault_that_spoils_everything_leaves_no_valid_number(tmp_path: Path, name: str) -> None:
    text, fault, said = DOUBTED[name]
    fit = fit_of(tmp_path, fault(log()), text)
    assert any(said in sentence for sentence in fit.verdict), fit.verdict
    assert {each.status for each in fit.estimates} == {Status.DOUBTFUL}


@pytest.mark.parametrize("name", REFUSED)
def test_a_log_that_cannot_be_used_is_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    text, fault, said = REFUSED[name]
    with pytest.raises(BenchError) as raised:
        fit_of(tmp_path, fault(log()), text)
    assert said in str(raised.value)
    assert str(raised.value).startswith(str(tmp_path))


@pytest.mark.parametrize("text", [FREE, LOADED, BOTH, GOAL], ids=["free", "loaded", "both", "goal"])
def test_a_sound_log_is_not_suspected(tmp_path: Path, text: str) -> None:
    fit = fit_of(tmp_path, log(), text)
    assert not fit.doubtful
    assert not any(word in said for said in fit.verdict for word in ("log.csv", "swapped", "sign"))
    assert confident_errors(fit) == []


@pytest.mark.long
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_fault_anywhere_gives_a_confident_wrong_number(tmp_path: Path, data: st.DataObject) -> None:
    """One fault of any kind, anywhere, of any size: refused, doubtful, or right within its interval."""
    columns = log()
    text = data.draw(st.sampled_from([FREE, LOADED]))
    name = data.draw(st.sampled_from(["t", "q", "u"] if text is FREE else ["t", "q", "u2", "tau"]))
    first = data.draw(st.integers(0, 2800))
    rows = slice(first, first + data.draw(st.integers(1, 400)))
    values = columns[name].copy()
    span = float(np.ptp(values))
    kind = data.draw(st.sampled_from(["missing", "constant", "turned", "leap", "clipped"]))
    match kind:
        case "missing":
            values[rows] = np.nan
        case "constant":
            values[rows] = values[first]
        case "turned":
            values = -values
        case "leap":
            values[first:] += data.draw(st.sampled_from([-1.0, 0.5, 2.0])) * span
        case "clipped":
            values = np.minimum(values, values.min() + data.draw(st.floats(0.5, 0.95)) * span)
    try:
        fit = fit_of(tmp_path, at(columns, name, values), text)
    except BenchError:
        return
    assert confident_errors(fit) == [], (kind, name, fit.verdict)
