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

from norton_sim.plants.assembled import Backlash, Spring
from norton_sim.plants.link import HALF_GAP, Link
from norton_sim.plants.motor_behind import MotorBehind
from norton_sim.quantities import Number

LoadFriction = Annotated[Number, Field(ge=0, lt=1)]


@njit(cache=True, nogil=True, inline="always")
def stretch(deviation: float, link: NDArray[np.float64]) -> float:
    """How far a connection is deflected beyond its backlash [rad], for a source ``deviation`` ahead of the port."""
    if deviation > link[HALF_GAP]:
        return float(deviation - link[HALF_GAP])
    if deviation < -link[HALF_GAP]:
        return float(deviation + link[HALF_GAP])
    return 0.0


class GearTrainTruth(MotorBehind):
    """``motor`` as reflected to the output; ``load_friction`` is μ. At rest its source is the backlash's middle."""

    model: Literal["gear_train"]
    backlash: Backlash
    load_friction: LoadFriction = 0.0

    @property
    def connection(self) -> Spring:
        return self.backlash

    @property
    def link(self) -> Link:
        return self._link(half_gap=self.backlash.width_rad / 2, load_friction=self.load_friction)

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction: nothing in the backlash."""
        deviation, half = command - angle_rad, self.backlash.width_rad / 2
        return self.stiffness_nm_rad * (deviation - min(max(deviation, -half), half))
