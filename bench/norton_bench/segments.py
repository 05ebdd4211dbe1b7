"""What a procedure asks of the loop: a stretch of time with everything known ahead, tick by tick."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from math import isfinite
from typing import TypeVar

import numpy as np

from norton_bench.arrays import FloatArray

# The steps that measure tables, and how the names of the segments begin in which something is read.
TABULATE_SOURCE, TABULATE_IMPEDANCE = "tabulate_source", "tabulate_impedance"
READ, HOLD = "read", "hold"
RENDER = "render"  # the step in which the load acts a law with a body


Angle = TypeVar("Angle", float, FloatArray)


class LoadMode(Enum):
    """What the load drive does during a segment."""

    UNDRIVEN = "undriven"  # zero load torque: the load coasts
    TORQUE = "torque"  # open loop: ``load_torque_nm`` as it stands
    ADMITTANCE = "admittance"  # the admittance law below


# What a law consists of, in the order of Admittance.values, and its units.
LAW_UNITS = {"mass": "kg*m^2", "damping": "N*m*s/rad", "stiffness": "N*m/rad"}


@dataclass(frozen=True)
class Admittance:
    """The virtual dynamics imposed at the port: M dv/dt + B (v − v_ref) + K (x − x_ref) = τ_port.

    ``wall_rad``: the spring is a wall, which begins at this angle from the reference and acts on that side alone; None
    for a spring to both sides of the reference.

    All zero asks for zero torque: the controller takes the least mass and damping that its calibration allows.
    ``rigid`` asks for prescribed motion: the greatest stiffness that its calibration allows.
    """

    mass_kgm2: float = 0.0
    damping_nms_rad: float = 0.0
    stiffness_nm_rad: float = 0.0
    rigid: bool = False
    wall_rad: float | None = None

    @classmethod
    def of(cls, values: Iterable[float], wall_rad: float | None = None) -> "Admittance":
        """With this mass, damping and stiffness."""
        mass_kgm2, damping_nms_rad, stiffness_nm_rad = values
        return cls(mass_kgm2, damping_nms_rad, stiffness_nm_rad, wall_rad=wall_rad)

    @property
    def values(self) -> tuple[float, float, float]:
        """Mass, damping and stiffness."""
        return self.mass_kgm2, self.damping_nms_rad, self.stiffness_nm_rad

    @property
    def has_body(self) -> bool:
        """Whether it is neither of its two ends: a virtual body moves by it, which the load follows."""
        return not self.rigid and any(self.values)

    @property
    def shortcoming(self) -> str:
        """Why it is no law at all; empty where it is one."""
        numbers = [*self.values, 0.0 if self.wall_rad is None else self.wall_rad]
        if not all(map(isfinite, numbers)) or min(self.values) < 0.0:
            return "a law must have finite numbers, and no negative mass, damping or stiffness"
        if self.wall_rad is not None and self.stiffness_nm_rad == 0.0:
            return "a wall needs a stiffness"
        return ""

    @property
    def words(self) -> str:
        """The law with its units; what is zero is left out."""
        if self.rigid:
            return "prescribed motion"
        named = zip(LAW_UNITS.items(), self.values, strict=True)
        law = ", ".join(f"{value:.3g} {unit} of {name}" for (name, unit), value in named if value) or "zero torque"
        return law if self.wall_rad is None else f"{law} beyond {self.wall_rad:.3g} rad"

    def deflection_rad(self, turned_rad: Angle) -> Angle:
        """Of the spring, where the port has turned so far from the reference."""
        if self.wall_rad is None:
            return turned_rad
        side = -1.0 if self.wall_rad < 0.0 else 1.0
        into = side * (turned_rad - self.wall_rad)
        return side * 0.5 * (into + abs(into))


# From one law with a body to another: long beside the loop's own transients of some 10 ms, short for a hand.
GLIDE_S = 0.5
ZERO_TORQUE = Admittance()
PRESCRIBED_MOTION = Admittance(rigid=True)


class Use(Enum):
    """What a segment's samples may be used for."""

    PREPARE = "prepare"  # approach, settling: recorded, not fitted
    TARE = "tare"
    CALIBRATE = "calibrate"  # the load's own dynamics
    IDENTIFY = "identify"
    VALIDATE = "validate"  # never fitted


@dataclass(frozen=True)
class Segment:
    """One stretch of the experiment; every array has shape (ticks,).

    ``position_rad`` is relative to where an imposed motion before it ended, else to where the load stands when the
    segment begins. ``preview`` says that the reference motion is the free motion predicted from the network identified
    so far, to be fed forward under zero torque.
    ``mends_rad_s`` is how quickly feedback then does best to mend what is left; None for as quickly as it can.
    """

    procedure: str
    name: str
    use: Use
    command: FloatArray  # actuator command, in its own unit
    mode: LoadMode = LoadMode.UNDRIVEN
    admittance: Admittance = ZERO_TORQUE
    position_rad: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity_rad_s: FloatArray = field(default_factory=lambda: np.empty(0))
    acceleration_rad_s2: FloatArray = field(default_factory=lambda: np.empty(0))
    load_torque_nm: FloatArray = field(default_factory=lambda: np.empty(0))
    preview: bool = False
    mends_rad_s: float | None = None
    modulation: FloatArray = field(default_factory=lambda: np.empty(0))  # of the modulator; empty: zero throughout
    stop_at_velocity_rad_s: float = float("inf")  # end early, without alarm, once |actuator velocity| reaches this

    @property
    def ticks(self) -> int:
        return len(self.command)

    def continued(self, last: int, kept: int, pushing: int, ticks: int, tick_s: float) -> "Segment":
        """What follows where nobody says what comes after tick ``last``, with which it ended.

        A prescribed motion goes on at its velocity then; the actuator's command stays for ``kept`` ticks and the load's
        torque for ``pushing``, then both are zero.
        """
        motion = _held(self.velocity_rad_s, last, ticks, ticks)
        return replace(
            self,
            name=f"after {self.name}",
            use=Use.PREPARE,
            command=_held(self.command, last, kept, ticks),
            position_rad=motion * tick_s * np.arange(1, len(motion) + 1),
            velocity_rad_s=motion,
            acceleration_rad_s2=0.0 * motion,
            load_torque_nm=_held(self.load_torque_nm, last, pushing, ticks),
            modulation=_held(self.modulation, last, ticks, ticks),
            stop_at_velocity_rad_s=float("inf"),
        )


def _held(values: FloatArray, last: int, kept: int, ticks: int) -> FloatArray:
    """``values[last]`` for ``kept`` of the ticks, then zero; empty where there are none."""
    return np.where(np.arange(ticks) < kept, values[last], 0.0) if len(values) else values
