"""What the controller and the guard see at one tick: the newest of every signal that they use, with its age."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from norton_drivers.readings import CurrentReading, MotionReading, TorqueReading

NAN = float("nan")
# Stand for readings that have not come yet: later than any tick, with a number that no reading has.
NEVER_NS = 2**63
NO_MOTION = MotionReading(-1, NEVER_NS, NAN, NAN)
NO_CURRENT = CurrentReading(-1, NEVER_NS, NAN)
NO_TORQUE = TorqueReading(-1, NEVER_NS, NAN)


class Sample(NamedTuple):
    """The newest value of every signal at ``tick_ns``; NaN and an age of -1 where nothing has arrived yet.

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
    current_age_ns: int = -1
    current_new: bool = False
    load_current_a: float = NAN
    load_current_age_ns: int = -1
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
        motion: MotionReading = newest["motion"]
        load: MotionReading = newest["load_motion"]
        torque: TorqueReading = newest["torque"]
        current: CurrentReading = newest["current"]
        load_current: CurrentReading = newest["load_current"]
        modulator: MotionReading = newest["modulator_motion"]
        # What arrives while the tick reads its ports has an age of 0, not a negative one.
        torque_age_ns, motion_age_ns, load_age_ns, current_age_ns, load_current_age_ns, modulator_age_ns = [
            max(tick_ns - each.arrival_ns, 0 if each.sequence >= 0 else -1)
            for each in (torque, motion, load, current, load_current, modulator)
        ]
        return Sample(
            tick_ns=tick_ns,
            torque_nm=torque.torque_nm - self.torque_bias_nm if torque.valid else NAN,
            torque_age_ns=torque_age_ns,
            torque_new="torque" in arrivals,
            position_rad=motion.position_rad,
            velocity_rad_s=motion.velocity_rad_s,
            motion_age_ns=motion_age_ns,
            motion_new="motion" in arrivals,
            load_position_rad=load.position_rad,
            load_velocity_rad_s=load.velocity_rad_s,
            load_motion_age_ns=load_age_ns,
            load_motion_new="load_motion" in arrivals,
            current_a=current.current_a,
            current_age_ns=current_age_ns,
            current_new="current" in arrivals,
            load_current_a=load_current.current_a,
            load_current_age_ns=load_current_age_ns,
            load_current_new="load_current" in arrivals,
            torque_count=len(new("torque", ())),
            motion_count=len(new("motion", ())),
            load_motion_count=len(new("load_motion", ())),
            modulator_position_rad=modulator.position_rad,
            modulator_motion_age_ns=modulator_age_ns,
            lateness_ns=tick_ns - deadline_ns,
        )
