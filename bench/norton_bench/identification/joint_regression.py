"""The regression of a motor behind a joint: what the port then feels is computed under the measured motion.

    τ = τ_j − J·ω̇,     τ_j that of models/joint_steps.py, under the command and the port's motion at t + d_m

Nothing but the port's motion and the command enter, both almost without errors; the torque, which is noisy, is what is
explained. (The motor's angle could be had from the torque, q = θ + τ_j/k, and the motor's own regression be solved. But
then the torque's noise would enter twice differentiated, and friction would follow a noisy path.)

All of the joint's values are over the motor's inertia. So τ is a homogeneous function of what the plain regression is
linear in: the sum of these unknowns, each times the slope with it, is the torque itself (Euler). Slopes thus stand in
for columns wherever a plain regression's are used, at the values that they were taken at.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.identification import loops
from norton_bench.identification.regression import Memory, Regression
from norton_bench.identification.rows import Rows
from norton_bench.identification.shape import (
    COULOMB,
    DAMPING,
    GAIN,
    INERTIA,
    LINEAR,
    SMALL_S,
    VISCOUS,
    Shape,
)
from norton_bench.identification.signals import FINE
from norton_bench.models import joint_steps
from norton_bench.models.terms import (
    DAMPING_DRIFT,
    FRICTION_DRIFT,
    GAIN_DRIFT,
    JOINT_DAMPING,
    JOINT_STIFFNESS,
    joint_of,
    joint_values,
)

# Of differences that stand for slopes, relative. A resonance bends the torque over a larger share of the stiffness.
STEP = 3e-3
# Of the contact's deflection in full use: a difference in the friction's state.
STATE_STEP = 0.1
# What came out as nothing has no scale of its own: shares of the Coulomb torque, and of the damping that lets a contact
# of the rotor's frequency ring no more.
LEAST_WAVE = 0.02
LEAST_DAMPING = 0.1


@dataclass(frozen=True)
class Driven:
    """One stretch on the motion's own clock, at its fine grid.

    ``lagged`` (n,) is what drives the motor, per unit of torque gain, as means from each sample to the next; ``drifts``
    (2, n), or (2, 1), are the factors in time of the contact's strength and of the damping.
    """

    lagged: FloatArray
    drifts: FloatArray

    @classmethod
    def of(cls, rows: Rows, shape: Shape) -> "Driven":
        signals = rows.signals
        later_s = shape.command_delay_s + shape.motion_delay_s
        step_s, count = signals.tick_s / FINE, signals.path_rad.size
        lagged = loops.mean_lag_of_held(
            signals.sent_s + later_s,
            signals.command,
            shape.bandwidth_rad_s,
            signals.time_s[0] + 0.5 * step_s,
            step_s,
            count,
            signals.released_at_zero,
        )
        return cls.after(lagged, signals.time_s[0] + np.arange(count) * step_s - rows.middle_s, shape)

    @classmethod
    def after(cls, lagged: FloatArray, time_s: FloatArray, shape: Shape) -> "Driven":
        """From what is behind the amplifier's lag, (n,), at instants (n,) from the middle of the session on."""
        if not any(each.term.in_time for each in shape.terms):
            return cls(lagged, np.ones((2, 1)))
        gain, *others = (shape.drifted(each, time_s) for each in (GAIN_DRIFT, FRICTION_DRIFT, DAMPING_DRIFT))
        return cls(lagged * gain, np.stack(others))


@dataclass(frozen=True)
class JointModel:
    """A motor behind a joint, at one shape: ``linear`` are the five unknowns of LINEAR, then two of each wave."""

    shape: Shape
    linear: FloatArray
    periods: tuple[float, ...] = ()

    @property
    def motor(self) -> joint_steps.MotorValues:
        gain, inertia, viscous, coulomb, sigma_1 = (float(value) for value in self.linear[: len(LINEAR)])
        s = self.shape.s_per_rad
        return (gain, self.shape.bandwidth_rad_s, inertia, viscous, s, coulomb * s, sigma_1)

    @property
    def joint(self) -> joint_steps.JointValues:
        return joint_values(self.shape.row, float(self.linear[INERTIA]))

    @property
    def waves(self) -> FloatArray:
        pairs = self.linear[len(LINEAR) :].reshape(-1, 2)
        return np.column_stack([np.array(self.periods), pairs]).reshape(-1, 3)

    def torque(
        self, driven: Driven, path_rad: FloatArray, step_s: float, begins: IntArray, states: FloatArray, moved: float
    ) -> FloatArray:
        """τ_j along a path, (n,); the rest as in joint_steps.behind."""
        motor = self.motor
        return np.asarray(
            joint_steps.behind(
                path_rad, motor[0] * driven.lagged, step_s, motor, self.joint, self.shape.row, self.waves,
                driven.drifts, begins, states, moved,
            )
        )  # fmt: skip


@dataclass(frozen=True)
class JointRegression(Regression):
    """``nominal`` are the values that it is linearised at: five unknowns of LINEAR and two of each wave of cogging."""

    nominal: FloatArray = field(default_factory=lambda: np.zeros(len(LINEAR)))

    @classmethod
    def behind(cls, plain: Regression, nominal: FloatArray) -> "JointRegression":
        """``plain``, of a motor that shapes put behind a joint."""
        return cls(plain.rows, cogging=plain.cogging, scales=plain.scales, nominal=nominal)

    def linearised_at(self, nominal: FloatArray) -> "JointRegression":
        """The same at other values of what is linear in the plain regression."""
        return replace(self, nominal=nominal[: len(LINEAR) + 2 * len(self.cogging)])

    def model(self, shape: Shape, linear: FloatArray | None = None) -> JointModel:
        return JointModel(shape, self.nominal if linear is None else linear, self.cogging)

    def prediction(self, model: JointModel) -> FloatArray:
        """Of the torque but for the sensor's zero, shape (samples,)."""
        return self._filtered(model, self._torques(model, self._begun(), 0.0))

    def columns(self, shape: Shape) -> tuple[FloatArray, Memory]:
        """Slopes with what is linear in the plain regression, bias: shape (unknowns, samples); and the memory.

        The first ones, times ``nominal``, sum to the prediction.
        """
        predicted, memory = self.explained(shape)
        model = self.model(shape)
        slopes = np.zeros((self.nominal.size, predicted.size))
        for place in range(1, self.nominal.size):
            moved = self.nominal.copy()
            moved[place] += (step := self._step(model, place))
            slopes[place] = (self.prediction(self.model(shape, moved)) - predicted) / step
        slopes[GAIN] = (predicted - self.nominal[1:] @ slopes[1:]) / self.nominal[GAIN]
        return np.concatenate([slopes, self.bias()]), memory

    def explained(self, shape: Shape) -> tuple[FloatArray, Memory]:
        """The prediction, (samples,), and what the friction may remember."""
        model = self.model(shape)
        states = self._begun()
        torques = self._torques(model, states, 0.0)
        other = self._torques(model, states, STATE_STEP / shape.s_per_rad)
        left = self._filtered(model, [b - a for a, b in zip(torques, other, strict=True)], of_joint=True)
        memory = Memory.of(left / (self.nominal[COULOMB] * STATE_STEP), self._rest)
        return self._filtered(model, torques), memory

    def jacobian(
        self,
        shape: Shape,
        columns: FloatArray,
        linear: FloatArray,
        memory: Memory | None = None,
        states: FloatArray | None = None,
    ) -> FloatArray:
        """As of the plain regression; slopes of the friction's state after rests are left out."""
        return np.stack(list(self._slopes(shape, self.nominal @ columns[: self.nominal.size])))

    def contamination(self) -> FloatArray:
        """None: what errors of the motion's readings do beside a joint is left to simulated records to tell."""
        return np.zeros(len(LINEAR))

    def carried(self, linear: FloatArray) -> FloatArray:
        """At most, as of the plain regression: the output has a share of the inertia, and no damping."""
        return np.array([1.0, linear[INERTIA] ** 2, 0.0])

    def slope_contamination(self, linear: FloatArray) -> float:
        """None, likewise."""
        return 0.0

    def _slopes(self, shape: Shape, predicted: FloatArray) -> Iterator[FloatArray]:
        at = shape.as_array()
        for place, step in enumerate(self.steps(shape)):
            moved = at.copy()
            moved[place] += step
            yield (self.prediction(self.model(shape.at(moved))) - predicted) / step

    def steps(self, shape: Shape) -> FloatArray:
        """Of differences that stand for slopes, in the order of the shape's unknowns, (unknowns,)."""
        steps = [STEP, STEP, SMALL_S, SMALL_S]
        places = iter(self.scales.tolist())
        rate = float(np.sqrt(shape.row[JOINT_STIFFNESS]))
        for each in shape.terms:
            for parameter in each.term.parameters:
                own = rate if parameter.column == JOINT_DAMPING and each is joint_of(shape.terms) else 1.0
                scale = next(places)
                steps.append(STEP if parameter.logarithmic else STEP * scale * own)
        return np.array(steps)

    def _step(self, model: JointModel, place: int) -> float:
        """Of one of the linear unknowns."""
        value, linear = float(self.nominal[place]), self.nominal
        least = 0.0
        if place >= len(LINEAR):
            least = LEAST_WAVE * abs(linear[COULOMB])
        elif place in (VISCOUS, DAMPING):
            least = LEAST_DAMPING * float(np.sqrt(abs(linear[INERTIA] * linear[COULOMB]) * model.shape.s_per_rad))
        return STEP * max(abs(value), least)

    def _begun(self) -> list[FloatArray]:
        return [_begun(rows) for rows in self.rows]

    def _torques(self, model: JointModel, states: list[FloatArray], moved: float) -> list[FloatArray]:
        result = []
        for rows, begun in zip(self.rows, states, strict=True):
            result.append(_torque(model, rows, begun, moved))
        return result

    def _filtered(self, model: JointModel, torques: list[FloatArray], *, of_joint: bool = False) -> FloatArray:
        """At the rows, (samples,): what the port feels of ``torques`` of the joint, (n · FINE,) a stretch."""
        delay_s, output_inertia = model.shape.motion_delay_s, 0.0 if of_joint else model.joint[2]
        parts = []
        for rows, torque in zip(self.rows, torques, strict=True):
            port = rows.of_fine_signal(torque, (0,), delay_s)[0]
            parts.append(port - output_inertia * rows.kinematics(model.shape)[1] if output_inertia else port)
        return self.chosen(parts)


def _begun(rows: Rows) -> FloatArray:
    """Room for the motor's state where a stretch begins, there that of the port, and after each of its rests."""
    states = np.zeros((1 + rows.signals.rests.size, 3))
    path_rad = rows.signals.path_rad
    states[0] = path_rad[0], (path_rad[1] - path_rad[0]) * FINE / rows.signals.tick_s, 0.0
    return states


def _torque(model: JointModel, rows: Rows, begun: FloatArray, moved: float) -> FloatArray:
    """τ_j along the path of one stretch, (n · FINE,)."""
    begins = np.concatenate([[0], rows.signals.rests * FINE]).astype(np.int64)
    driven, step_s = Driven.of(rows, model.shape), rows.signals.tick_s / FINE
    return np.asarray(model.torque(driven, rows.signals.path_rad, step_s, begins, begun, moved))
