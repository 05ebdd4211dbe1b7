"""A pneumatic muscle against a spring (paper, section IV.C.2): I dω/dt = (π − θ)² c − K θ − B ω − friction − τ.

The command c [N m/rad] is the muscle's pressure; it cannot push (c ≥ 0), and is slack beyond θ = π.
"""

import math
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from norton_sim.plants.assembled import Assembled
from norton_sim.plants.link import MUSCLE, SPRING, Link, row_of
from norton_sim.quantities import Stiffness


@njit(cache=True, nogil=True, inline="always")
def pull(angle: float, command: float, link: NDArray[np.float64]) -> float:
    """What muscle and spring turn the port's body with [N m]."""
    length = max(math.pi - angle, 0.0)
    return float(length * length * max(command, 0.0) - link[SPRING] * angle)


class PneumaticMuscleTruth(Assembled):
    """``spring`` is K, ``output`` the inertia I with its friction."""

    model: Literal["pneumatic_muscle"]
    spring_nm_rad: Stiffness = Field(alias="spring", gt=0, examples=["0.2 N*m/rad"])

    @property
    def link(self) -> Link:
        return Link(row_of(drive=MUSCLE, command_per_ampere=self.command_per_ampere, spring=self.spring_nm_rad))

    @property
    def torque_constant_nm_a(self) -> float:
        return math.pi**2 / self.amplifier_gain

    def source_rad(self, command: float) -> float:
        """Where the free port rests: 0 = (π − θ_N)² c − K θ_N, the root between 0 and π."""
        if command <= 0.0:
            return 0.0
        half = math.pi + self.spring_nm_rad / (2 * command)
        return half - math.sqrt(half * half - math.pi**2)

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts, held at an angle: K (θ_N (π − θ)² / (π − θ_N)² − θ), less friction."""
        return (math.pi - angle_rad) ** 2 * command - self.spring_nm_rad * angle_rad
