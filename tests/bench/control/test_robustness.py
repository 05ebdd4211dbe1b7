"""Responses of the closed loop, against one that is integrated between the ticks."""

from math import pi

import numpy as np
import pytest
from scipy.linalg import expm

from norton_bench.control.design import design_tracking, nominal_bench
from norton_bench.control.regulator import STATES, TWIST_RATE, VELOCITY
from norton_bench.control.robustness import LEAST_DAMPING, swing_response, tracking_control
from tests.bench.control.test_design import CALIBRATION, TICK_S

SUBSTEPS = 50


@pytest.mark.parametrize("frequency_hz", [2.0, 12.0, 40.0, 90.0])
def test_a_held_shaft_swings_as_the_loop_does_when_it_runs(frequency_hz: float) -> None:
    """The acceleration of the free actuator is a sine, held from tick to tick; what it does between a tick and the
    instant of a reading is left out of the response."""
    tracking, ticks = design_tracking(CALIBRATION, TICK_S), 3000
    control = tracking_control(tracking.observer, tracking.regulator)
    bench = nominal_bench(CALIBRATION, TICK_S).with_damping(LEAST_DAMPING)
    a, b = bench.matrices()
    step_s = TICK_S / SUBSTEPS
    flow = expm(np.block([[a, b], [np.zeros((3, STATES + 3))]]) * step_s)[:STATES]
    late = [round(delay_s / step_s) for delay_s in bench.delays_s()]
    acts = round(bench.command_delay_s / step_s)
    past, sent = np.zeros((ticks * SUBSTEPS + 1, STATES)), np.zeros(ticks + 1)
    state, rows = np.zeros(len(control.step)), bench.outputs()
    forced = np.sin(2 * pi * frequency_hz * np.arange(ticks) * TICK_S)
    for tick in range(ticks):
        now = tick * SUBSTEPS
        readings = np.array([row @ past[max(now - ago, 0)] for row, ago in zip(rows, late, strict=True)])
        sent[tick] = control.direct @ readings + control.wish @ state
        state = control.step @ state + control.entry @ readings
        for substep in range(now, now + SUBSTEPS):
            in_force = sent[(substep - acts) // SUBSTEPS] if substep >= acts else 0.0
            past[substep + 1] = flow @ [*past[substep], in_force, 0.0, forced[tick]]
    swing = past[::SUBSTEPS, VELOCITY] + past[::SUBSTEPS, TWIST_RATE]
    phase = np.exp(-2j * pi * frequency_hz * np.arange(ticks // 2, ticks) * TICK_S)
    amplitude = 2.0 * abs(np.mean(swing[ticks // 2 : ticks] * phase))
    (expected,) = np.abs(swing_response(bench, control, TICK_S, np.array([2 * pi * frequency_hz * TICK_S])))
    assert amplitude == pytest.approx(expected, rel=0.1)
