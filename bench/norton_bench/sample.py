"""What the controller and the guard see at one tick: the newest of every signal that they use, with its age."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from norton_drivers.readings import CurrentReading, MotionReading, TorqueReading

NAN = float("nan")
# Stand for readings that have not come yet.
NO_MOTION, NO_CURRENT, NO_TORQUE = MotionReading(-1, 0, NAN, NAN), CurrentReading(-1, 0, NAN), TorqueReading(-1, 0, NAN)


class Sample(NamedTuple):
    """The newest value of every signal at ``tick_ns``, and its age where that is used; NaN and -1 before it arrives.

    ``torque_nm`` is what the actuator exerts on the load, tared. ``*_new`` says whether a reading arrived since the
    last tick: a repeat is not a measurement. ``*_count`` says how many did: where many come at once, they were held up
    on their way, and their arrivals say little of when they were true. ``lateness_ns`` is by how much ``tick_ns``, when
    the readings were taken, comes after the tick's deadline, from which the controller counts.
    """

    tick_ns: int
    torque_nm: float = NAN
    torque_age_ns: int = -1
    torque_new: bool = False
    position_rad: float = NAN
    velocity_rad_s: float = NAN
    motion_age_ns: int = -1
    motion_new: bool = False
    load_position_rad: float = NAN
    load_velocity_rad_s: float = NAN
    load_motion_age_ns: int = -1
    load_motion_new: bool = False
    current_a: float = NAN
    current_new: bool = False
    load_current_a: float = NAN
    load_current_new: bool = False
    torque_count: int = 0
    motion_count: int = 0
    load_motion_count: int = 0
    modulator_position_rad: float = NAN
    modulator_motion_age_ns: int = -1
    lateness_ns: int = 0


class Target(NamedTuple):
    """Where the admittance law's reference stands at one tick (absolute position of the load shaft)."""

    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    acceleration_rad_s2: float = 0.0


def _nothing_yet() -> dict[str, Any]:
    return {
        "motion": NO_MOTION,
        "load_motion": NO_MOTION,
        "torque": NO_TORQUE,
        "current": NO_CURRENT,
        "load_current": NO_CURRENT,
        "modulator_motion": NO_MOTION,
    }


@dataclass
class Alignment:
    """From readings, each with its own arrival time, to one sample a tick: keeps the newest of every stream."""

    torque_bias_nm: float = 0.0
    _newest: dict[str, Any] = field(default_factory=_nothing_yet, init=False)  # by the stream's name

    def update(self, tick_ns: int, deadline_ns: int, arrivals: Mapping[str, Sequence[Any]]) -> Sample:
        """The sample at ``tick_ns``, given what arrived since the last one: by stream, oldest first."""
        newest, new = self._newest, arrivals.get
        for name, readings in arrivals.items():
            newest[name] = readings[-1]
        torque: TorqueReading = newest["torque"]
        motion: MotionReading = newest["motion"]
        load: MotionReading = newest["load_motion"]
        current: CurrentReading = newest["current"]
        load_current: CurrentReading = newest["load_current"]
        modulator: MotionReading = newest["modulator_motion"]
        # By position, in the order of the fields: by keyword it takes four times as long. What arrives while the tick
        # reads its ports has an age of 0, not a negative one.
        return Sample(
            tick_ns,
            torque.torque_nm - self.torque_bias_nm if torque.valid else NAN,
            -1 if torque is NO_TORQUE else max(0, tick_ns - torque.arrival_ns),
            "torque" in arrivals,
            motion.position_rad,
            motion.velocity_rad_s,
            -1 if motion is NO_MOTION else max(0, tick_ns - motion.arrival_ns),
            "motion" in arrivals,
            load.position_rad,
            load.velocity_rad_s,
            -1 if load is NO_MOTION else max(0, tick_ns - load.arrival_ns),
            "load_motion" in arrivals,
            current.current_a,
            "current" in arrivals,
            load_current.current_a,
            "load_current" in arrivals,
            len(new("torque", ())),
            len(new("motion", ())),
            len(new("load_motion", ())),
            modulator.position_rad,
            -1 if modulator is NO_MOTION else max(0, tick_ns - modulator.arrival_ns),
            tick_ns - deadline_ns,
        )
