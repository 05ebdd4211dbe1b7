"""A motor behind gears with backlash and friction that grows with the load (paper, section VI).

    Jm d²q/dt² = τ_drive − B dq/dt − friction(q) − τ_mesh,    J dω/dt = τ_mesh − friction(θ) − τ,
    τ_mesh = k (δ ∓ b/2) + d dδ/dt beyond half of the backlash b, else 0,    δ = q − θ,

and the motor's friction is bounded by τc + μ |k (δ ∓ b/2)|: it loses the share μ of what it transmits.
"""

from typing import Annotated, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from sim_backend.plants.assembled import Assembled, Backlash, Motor, Servo, in_series_nm_rad, servo_columns
from sim_backend.plants.link import HALF_GAP, SERVO, TORQUE, Link, row_of
from sim_backend.quantities import Number

LoadFriction = Annotated[Number, Field(ge=0, lt=1)]


@njit(cache=True, nogil=True, inline="always")
def stretch(deviation: float, link: NDArray[np.float64]) -> float:
    """How far a connection is deflected beyond its backlash [rad], for a source ``deviation`` ahead of the port."""
    if deviation > link[HALF_GAP]:
        return float(deviation - link[HALF_GAP])
    if deviation < -link[HALF_GAP]:
        return float(deviation + link[HALF_GAP])
    return 0.0


class GearTrainTruth(Assembled):
    """``motor`` as reflected to the output; ``load_friction`` is μ."""

    model: Literal["gear_train"]
    motor: Motor
    backlash: Backlash
    load_friction: LoadFriction = 0.0
    servo: Servo | None = Field(default=None)

    @property
    def link(self) -> Link:
        row = row_of(
            drive=TORQUE if self.servo is None else SERVO,
            command_per_ampere=self.command_per_ampere,
            spring=self.backlash.stiffness_nm_rad,
            damper=self.backlash.damping_nm_s_rad,
            half_gap=self.backlash.width_rad / 2,
            load_friction=self.load_friction,
            **servo_columns(self.servo),
        )
        return Link(row, self.motor, self.mounted * self.motor.torque_constant_nm_a)

    @property
    def torque_constant_nm_a(self) -> float:
        if self.servo is None:
            return self.motor.torque_constant_nm_a
        return self.stiffness_nm_rad / self.amplifier_gain

    @property
    def stiffness_nm_rad(self) -> float:
        """Of the port beyond the backlash, but for friction."""
        mesh_nm_rad = self.backlash.stiffness_nm_rad
        return mesh_nm_rad if self.servo is None else in_series_nm_rad(mesh_nm_rad, self.servo.stiffness_nm_rad)

    def source_rad(self, command: float) -> float:
        """The middle of where the free port may rest under an angle commanded: half of the backlash to either side."""
        return command

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction: nothing in the backlash."""
        deviation, half = command - angle_rad, self.backlash.width_rad / 2
        return self.stiffness_nm_rad * (deviation - min(max(deviation, -half), half))
