"""A stiffness motor that does not go where it is sent, and those that do, late or by little."""

import pytest

from norton_bench.guard.check import Commands
from norton_bench.guard.drive_checks import StuckModulator
from norton_bench.sample import Sample
from tests.bench.guard.shafts import TICK_NS, ask, resting

COUNT_RAD = 5e-5


def check() -> StuckModulator:
    return StuckModulator(4.0, "N*m/rad", COUNT_RAD)


def at(tick: int, position_rad: float) -> Sample:
    return resting(tick)._replace(modulator_position_rad=position_rad, modulator_motion_age_ns=400_000)


def rising(tick: int) -> Commands:
    """By 1 N m/rad a second, from 2; the drives are enabled at zero."""
    return Commands(0.0, 0.0, modulation=2.0 + 1e-3 * tick)


@pytest.mark.parametrize("dither_rad", [0.0, COUNT_RAD])
def test_one_that_stands_is_found_a_while_after_its_command_has_changed(dither_rad: float) -> None:
    verdict = ask(check(), (at(k, 0.5 + dither_rad * (k % 2)) for k in range(2000)), rising)
    assert verdict.tick == 101
    assert "modulator encoder: stands still at 0.5" in verdict.said
    assert "though 100 ms ago its command had gone from 0 to 2.1 N*m/rad" in verdict.said


def test_one_that_follows_late_passes() -> None:
    assert ask(check(), (at(k, 0.25e-3 * max(k - 90, 0)) for k in range(2000)), rising).tick is None


def test_one_that_is_told_little_may_stand() -> None:
    small = [Commands(0.0, 0.0, modulation=0.39 * (k % 2)) for k in range(2000)]
    assert ask(check(), (at(k, 0.0) for k in range(2000)), lambda k: small[k]).tick is None


def test_it_is_found_in_either_direction() -> None:
    sent = [Commands(0.0, 0.0, modulation=-1e-3 * k) for k in range(2000)]
    assert ask(check(), (at(k, 0.5) for k in range(2000)), lambda k: sent[k]).tick == 501


def test_the_next_time_begins_afresh() -> None:
    looked = check()
    assert ask(looked, (at(k, 0.5) for k in range(90)), rising).tick is None
    later = [at(k + 2000, 0.5) for k in range(200)]
    assert later[0].tick_ns > 2000 * TICK_NS
    assert ask(looked, later, lambda _: Commands(0.0, 0.0, modulation=0.1)).tick is None
