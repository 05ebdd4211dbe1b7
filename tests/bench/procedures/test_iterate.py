"""A movement repeated until its port torque is noise, on the simulated bench through the real path."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import RigError
from norton_bench.identification.trials import TRIAL, TrialFigures, diverge, settled, trials
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.iterate import IterateProcedure, way
from norton_bench.procedures.knowledge import Knowledge, carry_out
from norton_bench.procedures.learning import Iteration, mean_corrections
from norton_bench.procedures.options import CalibrateOptions, IterateOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.records import join
from norton_bench.rig.load import load_rig
from norton_bench.session.run import learned
from tests.bench.bench_in_simulation import opened
from tests.bench.watched import Watched

pytestmark = pytest.mark.long

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
STEP = IterateProcedure(IterateOptions(trials=6, duration_s=2.0))


@dataclass(frozen=True)
class Iterated:
    known: Knowledge
    true_rms_nm: list[float]
    said: list[str]

    @property
    def state(self) -> Iteration:
        assert self.known.iteration is not None
        return self.known.iteration

    def below_db(self, number: int) -> float:
        """How far the true torque of a trial lies below that of the first."""
        return float(20 * np.log10(self.true_rms_nm[0] / self.true_rms_nm[number - 1]))


@pytest.fixture(scope="module")
def watched() -> Iterator[Watched]:
    with opened(RIG) as bench:
        yield Watched(bench)


@pytest.fixture(scope="module")
def calibrated(watched: Watched) -> Knowledge:
    known = carry_out(TareProcedure(TareOptions(duration_s=0.5)), Knowledge(RIG), watched.loop)
    watched.loop.learn(learned(known))
    known = carry_out(CalibrateProcedure(CalibrateOptions(duration_s=4.0)), known, watched.loop)
    watched.loop.learn(learned(known))
    return replace(known, command_span=(-0.08, 0.08))


@pytest.fixture(scope="module")
def iterated(watched: Watched, calibrated: Knowledge) -> Iterated:
    return carried_out(STEP, calibrated, watched)


def carried_out(step: IterateProcedure, known: Knowledge, watched: Watched) -> Iterated:
    watched.true_rms_nm.clear()
    said = []
    while (decision := step.following(known)).procedure is not None:
        said.append(decision.sentence)
        known = carry_out(decision.procedure, decision.known, watched)
    return Iterated(decision.known, list(watched.true_rms_nm), [*said, decision.sentence])


def with_actuator_off(known: Knowledge, share: float) -> Knowledge:
    """The first fit of the actuator made worse: this way up, that way down."""
    assert known.actuator is not None
    network = known.actuator.network
    worse = replace(
        network,
        torque_gain=network.torque_gain * (1 + share),
        inertia_kgm2=network.inertia_kgm2 * (1 - share),
        coulomb_torque_nm=network.coulomb_torque_nm * (1 - share),
        viscous_damping_nms_rad=network.viscous_damping_nms_rad * (1 + share),
    )
    return replace(known, actuator=replace(known.actuator, network=worse))


def test_the_true_port_torque_comes_down_to_a_fortieth(iterated: Iterated) -> None:
    """Cogging leaves 0.14 mN m beyond the band, and noise learnt from four trials as much within it: 0.2 of 9.6."""
    assert iterated.state.converged
    assert iterated.below_db(len(iterated.true_rms_nm)) > 32.0
    assert iterated.said[-1].endswith("converged")


def test_what_is_read_does_not_flatter(iterated: Iterated) -> None:
    """The first trial is far above the noise, and its figure that of the true torque."""
    assert iterated.state.trials[0].torque_nm == pytest.approx(iterated.true_rms_nm[0], rel=0.03)
    assert iterated.state.trials[0].noise_nm == pytest.approx(0.29e-3, rel=0.1)


def test_a_model_that_is_wrong_is_made_up_for_by_learning(watched: Watched, calibrated: Knowledge) -> None:
    step = IterateProcedure(STEP.options.model_copy(update={"trials": 4}))
    found = carried_out(step, with_actuator_off(calibrated, 0.1), watched)
    print(found.said)
    assert found.below_db(2) < 25.0  # what the undriven trial taught
    assert found.below_db(4) > 30.0


def test_every_trial_begins_where_the_first_did(iterated: Iterated) -> None:
    starts = []
    for record in iterated.known.records:
        for segment in record.segments:
            if segment.name.startswith(TRIAL):
                part = record.between(segment.start_ns, segment.end_ns)
                starts.append(part.ticks["load_position_rad"][0])
    assert np.ptp(starts) < 0.02
    assert len(starts) == len(iterated.state.trials)


def test_drives_are_idle_between_trials(iterated: Iterated) -> None:
    records = [each for each in iterated.known.records if each.segments[0].procedure == STEP.name]
    for before, after in pairwise(records):
        assert after.ticks["tick_ns"][0] > before.ticks["tick_ns"][-1] + 2 * RIG.tick_ns


def test_the_recording_alone_tells_the_same(iterated: Iterated) -> None:
    found = trials(join(iterated.known.records), RIG.tick_s, STEP.name)
    assert [each.number for each in found] == list(range(1, len(found) + 1))
    for told, known in zip(found, iterated.state.trials, strict=True):
        assert told.with_noise_nm == pytest.approx(known.with_noise_nm, rel=1e-3)
    assert settled(found)


def test_it_ends_at_the_number_of_trials_and_says_so(iterated: Iterated) -> None:
    known = replace(iterated.known, iteration=replace(iterated.state, trials=FAR_FROM_NOISE * 6, finished=False))
    decision = STEP.following(known)
    assert decision.procedure is None
    assert decision.known.iteration is not None
    assert not decision.known.iteration.converged
    assert "after 6 trials more than noise is left" in decision.sentence


def test_it_stops_where_it_does_not_converge(iterated: Iterated) -> None:
    trials_nm = (1e-2, 3e-3, 5e-3, 8e-3)
    figures = tuple(TrialFigures(n, torque_nm, 3e-4, 1e-4) for n, torque_nm in enumerate(trials_nm, 1))
    decision = STEP.following(
        replace(iterated.known, iteration=replace(iterated.state, trials=figures, finished=False))
    )
    assert decision.procedure is None
    assert "does not converge" in decision.sentence


def test_noise_that_was_learnt_is_no_failure_to_learn(iterated: Iterated) -> None:
    """One correction brings the noise of its trial to the port; four bring a quarter of its power: that is enough."""
    step = IterateProcedure(STEP.options.model_copy(update={"trials": 10}))

    def after(count: int, torque_nm: float) -> str:
        noise_nm = 3e-4
        figures = tuple(
            TrialFigures(n, float(np.hypot(torque_nm, noise_nm)), noise_nm, 1e-4, True, noise_nm / np.sqrt(n - 2))
            for n in range(3, count + 1)
        )
        trials = (TrialFigures(1, 1e-2, noise_nm, 1e-4, False), TrialFigures(2, 4e-4, noise_nm, 1e-4), *figures)
        state = replace(iterated.state, trials=trials, corrections=iterated.state.corrections[:1], finished=False)
        return step.following(replace(iterated.known, iteration=state)).sentence

    assert "converged" not in after(5, 1.4e-4)
    assert after(6, 1.4e-4).endswith("converged")
    assert "converged" not in after(6, 2.5e-4)


def test_trials_diverge_only_beside_one_that_was_better() -> None:
    def made(*torques_nm: float) -> tuple[TrialFigures, ...]:
        return tuple(TrialFigures(n, each, 3e-4, 1e-4, driven=n > 1) for n, each in enumerate(torques_nm, 1))

    assert diverge(made(1e-2, 2e-2, 2e-2))
    assert not diverge(made(1e-2, 2e-2))
    assert not diverge(made(1e-2, 1e-2, 1e-2, 1e-2))
    assert not diverge(made(1e-2, 5e-3, 9e-3, 6e-3))


def test_nothing_is_driven_by_a_fit_that_is_none(iterated: Iterated) -> None:
    assert iterated.known.actuator is not None
    known = replace(iterated.known, actuator=replace(iterated.known.actuator, converged=False))
    decision = STEP.following(known)
    assert decision.procedure is None
    assert "did not converge" in decision.sentence


def test_it_needs_a_load_drive() -> None:
    alone = load_rig(Path(__file__).parents[3] / "rigs" / "sim-free-shaft.toml")
    with pytest.raises(RigError, match="needs a load drive to go along with the actuator"):
        STEP.require(alone)


def test_the_way_back_is_as_long_as_it_should_be_and_no_faster() -> None:
    motion = way(-7.0, 20.0, 1e-3)
    assert motion.position_rad[-1] == pytest.approx(-7.0, rel=1e-3)
    assert np.max(np.abs(motion.velocity_rad_s)) <= 20.0
    assert abs(motion.velocity_rad_s[-1]) < 1e-3


FAR_FROM_NOISE = (TrialFigures(1, 1e-2, 3e-4, 1e-4),)


def test_what_noise_explains_is_not_learnt(iterated: Iterated) -> None:
    """Lessons of nothing but noise leave next to nothing of themselves; a torque well above it stays."""
    random, ticks = np.random.default_rng(4), len(iterated.state.command)
    noise = [replace(each, actuator_nm=1e-3 * random.standard_normal(ticks)) for each in iterated.state.corrections[1:]]
    mean = np.average([each.actuator_nm for each in noise], axis=0, weights=[each.weight for each in noise])
    kept, _ = mean_corrections(noise, ticks, 1e-3)
    assert np.std(kept) < 0.35 * np.std(mean)
    wave = 5e-3 * np.sin(2 * np.pi * 3.0 * np.arange(ticks) * RIG.tick_s)
    kept, _ = mean_corrections([replace(each, actuator_nm=wave) for each in noise], ticks, 1e-3)
    assert np.std(kept - wave) < 0.05 * np.std(wave)
