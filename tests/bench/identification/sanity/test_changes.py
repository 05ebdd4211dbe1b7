"""What is looked for before and after an instant counts the readings' errors as the fit does."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification import sanity_checks as looked_at
from norton_bench.identification.sanity_checks import BLOCK_ROWS, Blocks, failed_checks, loud
from norton_bench.identification.separable import Solution, solve
from norton_bench.identification.shape import INERTIA, VISCOUS
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Bench, Truth


@pytest.fixture(scope="module")
def coarse() -> Solution:
    """Free motion, then imposed, of a light actuator with a coarse encoder: the two tell very unlike accelerations."""
    truth, bench = Truth(inertia=2e-5), Bench(counts=8192.0, noise_nm=4e-3)
    measured = synthetic.experiment(2, truth, bench, blocked=False, multisine_s=10.0)
    return solve(signals(measured, TICK_S, Use.IDENTIFY))


@pytest.mark.long
def test_blocks_add_up_to_a_fit_that_is_at_its_optimum(coarse: Solution) -> None:
    """Were the errors in the columns left in, what pulls at the inertia would not be nil, but all of them."""
    blocks = Blocks.of(coarse)
    pull = blocks.score.sum(axis=0)
    scatter = np.sqrt(np.sum(blocks.score**2, axis=0))
    for column in (INERTIA, VISCOUS):
        assert abs(pull[column]) < scatter[column]
    left_in = coarse.contamination[INERTIA] * coarse.linear[INERTIA] / blocks.scale[INERTIA]
    assert left_in > 2.0 * scatter[INERTIA]


def test_a_machine_that_stays_the_same_is_not_doubted(coarse: Solution) -> None:
    nine = np.ones(9)
    assert failed_checks(coarse, nine, 0.01 * nine, tick_s=TICK_S) == ()


def test_what_is_told_grows_from_nothing_to_all(coarse: Solution) -> None:
    told = Blocks.of(coarse).told(INERTIA)
    assert told[0] == 0.0
    assert np.all(np.diff(told) >= -1e-12)  # but for rounding
    assert 0.5 < told[-1] < 1.0


@pytest.mark.long
def test_a_machine_has_changed_only_where_it_is_heard_over_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Feedback that holds the torque at zero makes the noise look like another delay, or another inertia."""
    measured = synthetic.experiment(2, Truth(), Bench(noise_nm=5e-3), blocked=False, multisine_s=10.0)
    heard = loud(solve(signals(measured, TICK_S, Use.IDENTIFY)))
    assert not heard[:12].any()  # free motion
    assert heard[-30:].all()  # imposed
    motion = measured.motion.copy()
    later = motion["arrival_ns"] > np.quantile(motion["arrival_ns"], 0.7)
    motion["arrival_ns"][later] -= 5 * 10**6
    solution, nine = solve(signals(replace(measured, motion=motion), TICK_S, Use.IDENTIFY)), np.ones(9)
    assert "is not the same throughout" in failed_checks(solution, nine, nine, tick_s=TICK_S)[0].sentence
    monkeypatch.setattr(looked_at, "loud", lambda _: np.arange(len(solution.innovation) // BLOCK_ROWS) < 12)
    assert failed_checks(solution, nine, nine, tick_s=TICK_S) == ()
