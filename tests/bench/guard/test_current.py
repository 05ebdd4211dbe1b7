"""A drive's current against its command: lag, noise and less than asked for pass; more, or against it, does not."""

from math import nan, sin

import pytest

from norton_bench.guard.check import EMPTY_MODEL, Commands, GuardModel
from norton_bench.guard.drive_checks import CurrentAgreement
from norton_bench.sample import Sample
from tests.bench.guard.shafts import ask, turning

KNOWN = GuardModel(amperes_per_command=18.0, load_amperes_per_nm=-5.0)
LAG_TICKS = 8


def wave(tick: int) -> Commands:
    return Commands(0.3 * sin(tick / 20), 0.6 * sin(tick / 30))


def sample(tick: int, current_a: float, load_current_a: float = 0.0) -> Sample:
    # A drive that tells its current every tenth tick.
    return turning(tick)._replace(
        current_a=current_a, load_current_a=load_current_a, current_new=tick % 10 == 0, load_current_new=tick % 10 == 5
    )


def honest(tick: int) -> Sample:
    acting = wave(max(tick - LAG_TICKS, 0))
    return sample(tick, 18.0 * acting.command, -5.0 * acting.load_torque_nm)


def actuator(known: GuardModel = KNOWN, unit: str = "N*m", amperes: float | None = None) -> CurrentAgreement:
    made = CurrentAgreement("actuator", 0.5, unit, amperes)
    made.learn(known)
    return made


def load(known: GuardModel = KNOWN) -> CurrentAgreement:
    made = CurrentAgreement("load", 1.0, "N*m")
    made.learn(known)
    return made


@pytest.mark.parametrize("made", [actuator, load])
def test_a_current_that_follows_late_passes(made) -> None:
    assert ask(made(), map(honest, range(2000)), wave).tick is None


@pytest.mark.parametrize("made", [actuator, load])
@pytest.mark.parametrize("factor", [0.0, 0.5, 1.25])
def test_less_current_or_a_little_more_passes(made, factor: float) -> None:
    samples = [
        s._replace(current_a=factor * s.current_a, load_current_a=factor * s.load_current_a)
        for s in map(honest, range(2000))
    ]
    assert ask(made(), samples, wave).tick is None


@pytest.mark.parametrize(
    ("made", "name"), [(actuator, "actuator drive: its current is"), (load, "load drive: its current is")]
)
@pytest.mark.parametrize("lie", [lambda a: a + 4.5, lambda a: a - 4.5, lambda a: 4 * a, lambda a: nan])
def test_more_current_than_was_asked_for_is_found(made, name: str, lie) -> None:
    samples = [
        s._replace(current_a=lie(s.current_a), load_current_a=lie(s.load_current_a)) if s.tick_ns > 5_500_000_000 else s
        for s in map(honest, range(2000))
    ]
    verdict = ask(made(), samples, wave)
    assert verdict.tick is not None
    assert 500 < verdict.tick < 700
    assert verdict.said.startswith(name)


def test_a_command_that_ended_leaves_no_current() -> None:
    def until_600(tick: int) -> Commands:
        return Commands(0.4, 0.0) if tick < 600 else Commands(0.0, 0.0)

    stays = [sample(tick, 18.0 * 0.4) for tick in range(2000)]
    verdict = ask(actuator(), stays, until_600)
    assert verdict.tick is not None
    assert 640 <= verdict.tick < 740
    assert "(0 to 0 N*m) ask for 0 to 0 A" in verdict.said


def test_a_current_against_the_command_is_found() -> None:
    verdict = ask(actuator(), [sample(tick, -18.0 * 0.4) for tick in range(500)], lambda _: Commands(0.4, 0.0))
    assert verdict.tick is not None


def test_one_wrong_reading_passes() -> None:
    samples = [honest(tick) for tick in range(1000)]
    samples[500] = samples[500]._replace(current_a=50.0)
    assert ask(actuator(), samples, wave).tick is None


@pytest.mark.parametrize("made", [actuator, load])
def test_nothing_is_said_before_it_is_known_what_a_command_makes(made) -> None:
    samples = [sample(tick, 50.0, 50.0) for tick in range(500)]
    assert ask(made(EMPTY_MODEL), samples).tick is None


def test_a_command_in_amperes_needs_no_learning() -> None:
    looked = actuator(EMPTY_MODEL, "mA", 1e-3)
    looked.learn(EMPTY_MODEL)
    assert ask(looked, [sample(tick, 0.5) for tick in range(500)], lambda _: Commands(500.0, 0.0)).tick is None
    assert ask(looked, [sample(tick, 2.0) for tick in range(500)], lambda _: Commands(500.0, 0.0)).tick is not None
