"""The ladder of friction models on the bench's own recordings: which of them the actuator's friction asks for.

Amplifier and delays are taken from the final fit; inertia, gain and the sensor's zero are fitted anew beside each
friction. It stands on the low band, in which what is left of the delays is harmless.
"""

from itertools import pairwise

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction.asymmetric import Asymmetric
from norton_bench.identification.friction.family import family_for
from norton_bench.identification.friction.model import Equation, Path, blocked_folds
from norton_bench.identification.ladder import Rung, ladder
from norton_bench.identification.regression import Regression, Shape
from norton_bench.identification.results import FitResult
from norton_bench.identification.separable import LOW_BAND
from norton_bench.identification.signals import FINE, Signals

# Ticks from row to row: twice the band's edge, and no more, for every model passes through here many times.
STRIDE = 10


def bench_ladder(stretches: tuple[Signals, ...], result: FitResult) -> tuple[Rung, ...]:
    """Every model that needs nothing but the motion, symmetric where it remembers.

    Empty where no torque was measured, or torque does not tell the scale: there is nothing to compare by.
    """
    if result.ratios_only or any(stretch.torque_nm is None for stretch in stretches):
        return ()
    equation = bench_equation(stretches, result)
    # Asymmetric elements by the dozen would take longer than all others together.
    quick = [model for model in family_for(equation.path) if not (isinstance(model, Asymmetric) and model.memory)]
    return ladder(equation, quick)


def bench_equation(stretches: tuple[Signals, ...], result: FitResult) -> Equation:
    """Torque at the port under the measured motion, with friction left open."""
    shape = Shape(
        result.network.amplifier_bandwidth_rad_s,
        result.network.presliding_stiffness_nm_rad / result.network.coulomb_torque_nm,
        result.command_delay_s,
        result.motion_delay_s,
    )
    regression = Regression.of(stretches, LOW_BAND, STRIDE)
    known = regression.chosen([np.stack([rows.lag(shape), -rows.kinematics(shape)[1]]) for rows in regression.rows])
    bias = regression.bias()
    path = _path(stretches)
    ends = [*path.starts, path.position.size]

    def process(rows: FloatArray) -> FloatArray:
        """The low-pass that torque and motion have passed too."""
        spans = zip(regression.rows, pairwise(ends), strict=True)
        parts = [part.of_tick_signals(rows[:, first:end], shape.motion_delay_s) for part, (first, end) in spans]
        return regression.chosen(parts)

    return Equation(
        target=regression.target(),
        others=np.concatenate([known, bias]),
        names=("torque_gain", "inertia", *(f"offset_{knot + 1}" for knot in range(len(bias)))),
        path=path,
        fold=blocked_folds(known.shape[1]),
        time_s=regression.time_s(),
        process=process,
    )


def _path(stretches: tuple[Signals, ...]) -> Path:
    positions = [np.ascontiguousarray(stretch.path_rad[::FINE]) for stretch in stretches]
    lengths = [len(position) for position in positions]
    tick_s = stretches[0].tick_s
    return Path(
        dt_s=tick_s,
        position=np.concatenate(positions),
        velocity=np.concatenate([np.gradient(position, tick_s) for position in positions]),
        starts=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
    )
