"""The running observer: what the bench between the two amplifiers is doing at this tick."""

from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from norton_bench.control import core
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.dynamics import POSITION, TWIST, TWIST_RATE, VELOCITY, FloatArray
from norton_bench.control.observer import FREE, INPUTS, OFFSET, WIDTH, Observer
from norton_bench.sample import Sample


@dataclass
class Estimator:
    """Once a tick :meth:`sense`, then :meth:`advance` with the command that was sent.

    ``states``, now and at the last ticks, are laid out as :mod:`norton_bench.control.observer` says; ``commands`` holds
    what was sent, the last one first. The contacts of both machines are carried along the load's position: under zero
    torque the actuator's is the same.
    """

    calibration: LoadCalibration
    tick_s: float
    observer: Observer
    commands: FloatArray = field(init=False)
    seen: bool = field(default=False, init=False)  # whether every signal has arrived at least once
    _mobility: float = field(default=0.0, init=False)  # of the actuator, while its friction counts as known

    def __post_init__(self) -> None:
        c, past = self.calibration, self.observer.past
        self.laws = friction_laws(c)
        self.friction_law = self.laws[0]
        self._delays_s = c.torque_delay_s, c.position_delay_s, c.position_delay_s
        self._clocks, self._begun_ns = np.zeros((3, 4)), 0
        self.contacts = np.zeros((2, 2))  # load's, actuator's: its force [N m], and the load's position at which it was
        self.contact = self.contacts[0]
        self.states, self._inputs = np.zeros((past + 1, WIDTH)), np.zeros((past + 1, INPUTS))
        self.commands = np.zeros(self.observer.whole + 2)
        self._compile()

    def motion(self) -> tuple[float, float]:
        """Position and velocity of the load [rad, rad/s]."""
        return float(self.states[0, POSITION]), float(self.states[0, VELOCITY])

    @property
    def contact_nm(self) -> float:
        """The force of the load's friction contact."""
        return float(self.contact[0])

    def torque_nm(self) -> float:
        """The port torque now."""
        c, x = self.calibration, self.states[0]
        return float(c.sensor_stiffness_nm_rad * x[TWIST] + c.sensor_damping_nms_rad * x[TWIST_RATE])

    def use(self, observer: Observer, *, knows_friction: bool) -> None:
        """Go on with another observer of the same past; ``knows_friction``: the actuator's is no disturbance to it."""
        inertia_kgm2 = self.calibration.actuator_inertia_kgm2
        mobility = 1.0 / inertia_kgm2 if knows_friction and inertia_kgm2 else 0.0
        if mobility != self._mobility:
            known_nm = core.friction(self.contacts[1, 0], self.states[0, VELOCITY], self.laws[1])
            self.states[:, FREE] += (mobility - self._mobility) * known_nm
        self.observer, self._mobility = observer, mobility

    def sense(self, sample: Sample) -> bool:
        """Take in what arrived; False where a signal is missing or is no number (the state then stays as it is)."""
        readings = (sample.torque_nm, sample.load_position_rad, sample.position_rad)
        if not isfinite(sample.torque_nm + sample.load_position_rad + sample.position_rad):
            return False
        if not self.seen:
            self._settle(sample)
        ages_s = 1e-9 * sample.torque_age_ns, 1e-9 * sample.load_motion_age_ns, 1e-9 * sample.motion_age_ns
        counts = sample.torque_count, sample.load_motion_count, sample.motion_count
        core.sense(
            self.states,
            self._inputs,
            self.contacts,
            self._clocks,
            readings,
            ages_s,
            self._delays_s,
            counts,
            1e-9 * (sample.tick_ns - self._begun_ns),
            self.tick_s,
            self.observer.rows,
            self.observer.gain,
            self.laws,
            POSITION,
        )
        return True

    def advance(self, command_nm: float) -> None:
        """Let one tick pass with ``command_nm`` on its way to the load."""
        if not self.seen:
            core.put_first(self.commands, command_nm)
            return
        core.advance(
            self.states,
            self._inputs,
            self.contacts,
            self.commands,
            command_nm,
            self.laws,
            self._mobility,
            self.observer.step,
            VELOCITY,
        )

    def _compile(self) -> None:
        """Before the loop runs: compiling takes seconds. Leaves everything at zero, and nothing seen."""
        self.advance(0.0)
        self.sense(
            Sample(
                0,
                torque_nm=0.0,
                torque_age_ns=0,
                torque_count=1,
                position_rad=0.0,
                motion_age_ns=0,
                motion_count=1,
                load_position_rad=0.0,
                load_motion_age_ns=0,
                load_motion_count=1,
            )
        )
        self.advance(0.0)
        self.seen = False
        self._clocks[:] = 0.0

    def _settle(self, sample: Sample) -> None:
        """Begin at rest where the readings are."""
        self._begun_ns = sample.tick_ns
        self._clocks[:, 1] = self.tick_s
        twist = sample.torque_nm / self.calibration.sensor_stiffness_nm_rad
        self.states[:] = 0.0
        self.states[:, POSITION] = self.contacts[:, 1] = sample.load_position_rad
        if isfinite(sample.load_velocity_rad_s):
            self.states[:, VELOCITY] = sample.load_velocity_rad_s
            self.states[:, POSITION] -= sample.load_velocity_rad_s * self.tick_s * np.arange(len(self.states))
        self.states[:, TWIST] = twist
        self.states[:, OFFSET] = sample.position_rad - sample.load_position_rad - twist
        self._inputs[:] = 0.0
        self.seen = True


def friction_laws(calibration: LoadCalibration) -> FloatArray:
    """B, τc, σ0 and σ1 of the load and of the actuator, (2, 4); the actuator's are 0 where they are not known."""
    c, laws = calibration, np.zeros((2, 4))
    for row, friction in zip(laws, (c, c.actuator_friction), strict=True):
        if friction is not None:
            row[:] = (
                friction.viscous_damping_nms_rad,
                friction.coulomb_torque_nm,
                friction.presliding_stiffness_nm_rad,
                friction.presliding_damping_nms_rad,
            )
    return laws
