"""What the controller and the guard see at one tick: the newest of every signal, with its age."""

from typing import NamedTuple

NAN = float("nan")


class Sample(NamedTuple):
    """The newest value of every signal at ``tick_ns``; NaN and an age of -1 where nothing has arrived yet.

    ``torque_nm`` is what the actuator exerts on the load, tared. ``*_new`` says whether a reading arrived since the
    last tick: a repeat is not a measurement. ``*_count`` says how many did: where many come at once, they were held up
    on their way, and their arrivals say little of when they were true.
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

    def counted_from(self, tick_ns: int) -> "Sample":
        """The same readings, with ages as of ``tick_ns``: negative for what arrived only after that."""
        later_ns = tick_ns - self.tick_ns
        # By position, once a tick: _replace takes twice as long.
        return Sample(
            tick_ns,
            self.torque_nm,
            self.torque_age_ns + later_ns,
            self.torque_new,
            self.position_rad,
            self.velocity_rad_s,
            self.motion_age_ns + later_ns,
            self.motion_new,
            self.load_position_rad,
            self.load_velocity_rad_s,
            self.load_motion_age_ns + later_ns,
            self.load_motion_new,
            self.current_a,
            self.current_age_ns + later_ns,
            self.current_new,
            self.load_current_a,
            self.load_current_age_ns + later_ns,
            self.load_current_new,
            self.torque_count,
            self.motion_count,
            self.load_motion_count,
            self.modulator_position_rad,
            self.modulator_motion_age_ns + later_ns,
        )


class Target(NamedTuple):
    """Where the admittance law's reference stands at one tick (absolute position of the load shaft)."""

    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    acceleration_rad_s2: float = 0.0
