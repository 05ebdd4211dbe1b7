"""A servo with a known load, simulated from its goal or its command alone: what is known of it and what is sought."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.logs.driven import inputs_of, load_of, loop_of
from norton_bench.logs.grid import Stretch
from norton_bench.logs.steps import Axis, Friction, Inputs, Load, Loop, Motor, simulate

# Of one step: half of it changes no result by more than an encoder's tick.
LONGEST_S = 1e-3
# From so many samples the velocity at the start is taken.
START_SAMPLES = 12

UNITS = {
    "torque_constant": ("N*m/A", "N/A"),
    "winding_resistance": ("ohm", "ohm"),
    "source_resistance": ("ohm", "ohm"),
    "inertia": ("kg*m^2", "kg"),
    "viscous_damping": ("N*m*s/rad", "N*s/m"),
    "coulomb_torque": ("N*m", "N"),
    "offset": ("N*m", "N"),
    "stribeck_torque": ("N*m", "N"),
    "load_coefficient": ("1", "1"),
    "load_stiction_coefficient": ("1", "1"),
    "stribeck_velocity": ("rad/s", "m/s"),
}


@dataclass(frozen=True)
class ServoModel:
    """One rung: the friction that a servo is taken to have; ``extra`` are its numbers beyond Coulomb and viscous."""

    name: str
    extra: tuple[str, ...] = ()


LADDER = (
    ServoModel("coulomb-viscous"),
    ServoModel("stribeck", ("stribeck_torque", "stribeck_velocity")),
    ServoModel("load-dependent", ("load_coefficient",)),
    ServoModel("load-dependent-stribeck", ("load_coefficient", "load_stiction_coefficient", "stribeck_velocity")),
)


@dataclass(frozen=True)
class ServoLog:
    """One uninterrupted part of a log: what acted, the position that came of it (n,), and where both begin."""

    inputs: Inputs
    load: Load
    loop: Loop
    position: FloatArray
    start_velocity: float

    @classmethod
    def of(cls, stretch: Stretch, *, translation: bool) -> "ServoLog":
        position, few = stretch.columns["position"], slice(0, START_SAMPLES)
        return cls(
            inputs=inputs_of(stretch)._replace(supply=_supply(stretch)),
            load=load_of(stretch, translation=translation),
            loop=loop_of(stretch, sampled=False),
            position=position,
            start_velocity=float(np.polyfit(stretch.time_s[few], position[few], 1)[0]),
        )


def _supply(stretch: Stretch) -> FloatArray:
    """What the drive is fed with: a switched drive's supply is read at any moment of the switching, so the middle."""
    if "supply" not in stretch.columns:
        return np.ones(len(stretch.time_s))
    return np.full(len(stretch.time_s), float(np.median(stretch.columns["supply"])))


def simulate_motion(log: ServoLog, values: Mapping[str, float], longest_s: float = LONGEST_S) -> FloatArray:
    """The position at the log's instants, shape (n,), from its start on. ``values`` by the names of ``UNITS``, in SI;
    what is not among them is zero."""
    get = values.get
    axis = Axis(
        inertia=values["inertia"],
        motor=Motor(values["torque_constant"], get("winding_resistance", 0.0), get("source_resistance", 0.0)),
        friction=Friction(
            viscous=get("viscous_damping", 0.0),
            coulomb=get("coulomb_torque", 0.0),
            stiction=get("stribeck_torque", 0.0),
            load_coefficient=get("load_coefficient", 0.0),
            load_stiction=get("load_stiction_coefficient", 0.0),
            stribeck_velocity=get("stribeck_velocity", 1.0),
        ),
        offset=get("offset", 0.0),
    )
    return simulate(axis, log.load, log.loop, log.inputs, float(log.position[0]), log.start_velocity, longest_s)


def joined_time(logs: Sequence[ServoLog]) -> FloatArray:
    """The instants of all logs, one after the other."""
    spans = [float(log.inputs.time_s[-1] - log.inputs.time_s[0]) for log in logs]
    begins = accumulate(spans, initial=0.0)
    return np.concatenate(
        [log.inputs.time_s - log.inputs.time_s[0] + begin for log, begin in zip(logs, begins, strict=False)]
    )
