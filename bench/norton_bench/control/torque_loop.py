"""Zero torque: feedback of the torque, and feed-forward of what the known friction will need."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from math import exp

import numpy as np
from scipy.linalg import expm

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import ActuatorFriction, LoadCalibration
from norton_bench.control.design import (
    TorqueGains,
    doubted_torque_nm,
    doubting_observer,
    holds,
    miscalibrated,
    nominal_bench,
    of_inertias,
    walls,
)
from norton_bench.control.observer import FREE, FREE_RATE, WIDTH, Observer, holds_at_any_age
from norton_bench.control.regulator import POSITION, VELOCITY, SampledBench
from norton_bench.control.robustness import Control, corrected, margins, observing, sizes

# Feedback, over what it would be without anticipation.
FEEDBACK_SHARE = 0.2
# What the observer believes of the free acceleration without friction, per root second and over the actuator's share of
# a doubted torque reading: the random walk of its rate [1/s]; its own is so much smaller. The quickest comes first; the
# slowest are for sensors that may have little damping.
RATES_PER_S = (500.0, 350.0, 250.0, 180.0, 125.0, 60.0, 30.0, 15.0)
WALK_S = 0.01
DOUBTS = (4.0, 8.0, 16.0, 32.0, 64.0)  # deviation taken for the encoders, in counts
# Peak sensitivity allowed, at the load's command, on every bench considered.
SENSITIVITY = 4.0
INERTIA_ERRORS = (1.0, 0.9, 1.1)
# Where an observer's step takes the known torque on the load, and the known part of the free acceleration.
KNOWN_TORQUE, KNOWN_FREE = WIDTH + 2, WIDTH + 3


# Zero torque by an observer that knows the actuator's friction: what the free motion needs is foreseen over the
# delay.
#
# Most of what feedback alone leaves at the port stands about the shaft's reversals: within a few milliseconds both
# frictions turn round, the load needs another torque, and a reading tells of it too late. Where the calibration knows
# the actuator's friction, that is no surprise. The observer takes it for known, so that what is left of the
# actuator's free acceleration is smooth; the motion is foreseen until a command sent now acts, with both contacts
# carried along; and the torque that takes the load along is fed forward. Torque feedback mends the rest, gently.
#
# Margins are those of two linear laws, both contacts sliding and both stuck, on every bench that the calibration may
# mean.
@dataclass(frozen=True)
class Anticipation:
    """An observer that knows the actuator's friction, how far it foresees, and the feedback that is left."""

    observer: Observer
    lead_s: float
    gains: TorqueGains


def design_anticipation(calibration: LoadCalibration, gains: TorqueGains, tick_s: float) -> Anticipation | None:
    """The quickest with margins; None where the actuator's friction is not known, or where none has margins.

    ``gains`` are those of feedback without anticipation.
    """
    friction = calibration.actuator_friction
    if friction is None or calibration.actuator_inertia_kgm2 is None:
        return None
    # A share of a command acts from its arrival to the next one's.
    lead_s = calibration.drive_delay_s + 0.5 * tick_s
    calm = TorqueGains(FEEDBACK_SHARE * gains.proportional, FEEDBACK_SHARE * gains.integral_per_s, 1.0, 0.0)
    laws = _Laws(calibration, friction, calibration.actuator_inertia_kgm2, calm, lead_s, tick_s)
    for observer in _observers(calibration, tick_s):
        if laws.hold(observer):
            return Anticipation(observer, lead_s, calm)
    return None


def _observers(calibration: LoadCalibration, tick_s: float) -> Iterator[Observer]:
    """From quick to slow."""
    bench, torque_nm = nominal_bench(calibration, tick_s), doubted_torque_nm(calibration)
    for rate_per_s, doubt in product(RATES_PER_S, DOUBTS):
        rate = rate_per_s * torque_nm / bench.actuator_inertia_kgm2
        observer = doubting_observer(calibration, bench, doubt, (WALK_S * rate, rate, torque_nm), tick_s)
        if holds_at_any_age(observer, bench, tick_s):
            yield observer


@dataclass(frozen=True)
class _Laws:
    """What the running controller does near a state in which both contacts slide, or both stick: there it is linear."""

    calibration: LoadCalibration
    friction: ActuatorFriction
    inertia_kgm2: float  # the actuator's
    gains: TorqueGains
    lead_s: float
    tick_s: float

    def hold(self, observer: Observer) -> bool:
        """Whether both keep their margins on all benches that the calibration may mean."""
        slides, sticks = self._sliding(observer), self._sticking(observer)
        wall = next(walls(self.calibration, self.tick_s))
        return (
            holds(slides, self._sliding_benches(), SENSITIVITY, self.tick_s)
            and holds(sticks, self._sticking_benches(), SENSITIVITY, self.tick_s)
            and margins(wall, slides, self.tick_s).stable
        )

    def _sliding(self, observer: Observer) -> Control:
        """Forces of the contacts stand still, whatever the shaft does."""
        c, row = self.calibration, np.zeros(WIDTH)
        row[FREE], row[FREE_RATE] = c.inertia_kgm2, c.inertia_kgm2 * self.lead_s
        row[VELOCITY] = c.viscous_damping_nms_rad
        row[VELOCITY] -= c.inertia_kgm2 * self.friction.viscous_damping_nms_rad / self.inertia_kgm2
        return self._control(observer, row)

    def _sticking(self, observer: Observer) -> Control:
        """Contacts are springs and dampers: what the observer takes for known follows its own state."""
        c, f = self.calibration, self.friction
        load, actuator = np.zeros(WIDTH), np.zeros(WIDTH)
        load[POSITION] = c.presliding_stiffness_nm_rad
        load[VELOCITY] = c.presliding_damping_nms_rad + c.viscous_damping_nms_rad
        actuator[POSITION] = f.presliding_stiffness_nm_rad
        actuator[VELOCITY] = f.presliding_damping_nms_rad + f.viscous_damping_nms_rad
        knowing = with_contact(observer, KNOWN_TORQUE, load, self.tick_s)
        knowing = with_contact(knowing, KNOWN_FREE, actuator / self.inertia_kgm2, self.tick_s)
        places = [POSITION, VELOCITY, FREE, FREE_RATE]
        free = np.zeros((4, 4))  # how the free actuator moves
        free[0, 1] = free[2, 3] = 1.0
        free[1] = np.array([0.0, 0.0, 1.0, 0.0]) - actuator[places] / self.inertia_kgm2
        row = np.zeros(WIDTH)
        row[places] = (c.inertia_kgm2 * free[1] + load[places]) @ expm(free * self.lead_s)
        return self._control(knowing, row)

    def _control(self, observer: Observer, row: FloatArray) -> Control:
        """u += P Δτ + I T τ + Δs, where s makes the amplifier deliver ``row`` · state."""
        body, commands = sizes(observer)
        seen, state = body + commands, corrected(observer)
        stays = exp(-self.calibration.amplifier_bandwidth_rad_s * self.tick_s)
        last_torque, last_needed, last_share = seen, seen + 1, seen + 2
        needed, needed_direct = np.zeros(seen + 3), row @ observer.gain[:WIDTH]
        needed[:seen] = row @ state[:WIDTH]
        share = needed.copy()
        share[last_needed] = -stays
        undone = 1 / ((1 - stays) * self.calibration.torque_gain)
        wish = undone * share
        wish[body] += 1.0
        wish[last_torque] -= self.gains.proportional
        wish[last_share] -= 1.0
        direct = undone * needed_direct
        direct[0] += self.gains.proportional + self.gains.integral_per_s * self.tick_s
        memory = np.stack([np.zeros(seen + 3), needed, undone * share])
        memory_entry = np.stack([[1.0, 0.0, 0.0], needed_direct, undone * needed_direct])
        return observing(observer, state, wish, direct, memory, memory_entry)

    def _sliding_benches(self) -> Iterator[SampledBench]:
        bench = nominal_bench(self.calibration, self.tick_s)
        return of_inertias(bench, (error * bench.actuator_inertia_kgm2 for error in INERTIA_ERRORS), self.tick_s)

    def _sticking_benches(self) -> Iterator[SampledBench]:
        c, f = self.calibration, self.friction
        stuck = replace(
            nominal_bench(c, self.tick_s),
            actuator_spring_nm_rad=f.presliding_stiffness_nm_rad,
            actuator_damper_nms_rad=f.presliding_damping_nms_rad,
            load_spring_nm_rad=c.presliding_stiffness_nm_rad,
            load_damper_nms_rad=c.presliding_damping_nms_rad,
        )
        return miscalibrated(stuck, self.tick_s)


def with_contact(observer: Observer, known: int, contact: FloatArray, tick_s: float) -> Observer:
    """The observer while a friction that it knows sticks: what it takes for known, at ``known`` of its inputs, is a
    spring and a damper on its own state, ``contact`` (WIDTH,)."""
    over_tick = contact.copy()
    over_tick[VELOCITY] += 0.5 * tick_s * contact[POSITION]  # known friction is its mean over the tick
    step = observer.step.copy()
    step[:, :WIDTH] -= np.outer(step[:, known], over_tick)
    return replace(observer, step=step)


# A shaft that moves is taken to have been moving so for this long.
MOVING_S = 0.1


@dataclass
class TorqueLoop:
    """Zero torque: proportional-integral feedback, damped while contacts stick and bolder while they slide.

    Changes of the command, once a tick.

    While a contact sticks the shaft behaves like a wall, and the port sees the whole command; once it has slid,
    only the actuator's share of the inertia. The distance since the shaft last turned says which. ``turn_rad`` is
    the distance over which contacts begin to slide, ``play_rad`` how far back is a turn and no noise.
    """

    gains: TorqueGains
    tick_s: float
    turn_rad: float
    play_rad: float
    slow: float = 1.0
    settles_s: float = 0.0
    _torque_nm: float = field(default=0.0, init=False)
    _damping_nm: float = field(default=0.0, init=False)
    _turned_at_rad: float = field(default=0.0, init=False)
    _farthest_rad: float = field(default=0.0, init=False)
    _began_rad: float = field(default=0.0, init=False)
    _reach_rad: float = field(default=0.0, init=False)
    _known_s: float = field(default=0.0, init=False)

    def begin(self, torque_nm: float, position_rad: float, velocity_rad_s: float) -> None:
        """Sticking where the shaft is at rest; one that moves has slid, and its damping ended long ago."""
        self._torque_nm = torque_nm
        self._turned_at_rad, self._farthest_rad = position_rad - MOVING_S * velocity_rad_s, position_rad
        self._began_rad, self._reach_rad, self._known_s = position_rad, 0.0, 0.0
        self._damping_nm = -self._sticking(position_rad) * self.gains.damping_nms_rad * velocity_rad_s

    def change_nm(self, torque_nm: float, position_rad: float, velocity_rad_s: float, *, bold: bool) -> float:
        """What to add to the last command; not ``bold`` where little is left to mend, and noise would be most of it."""
        self._follow(position_rad)
        sticking = self._sticking(position_rad)
        slides = self.gains.boost if bold else min(self.gains.boost, 1.0)
        boost = slides + (1 - slides) * sticking
        rise_nm, self._torque_nm = torque_nm - self._torque_nm, torque_nm
        share = self._share(position_rad)
        damping_nm = -share * sticking * self.gains.damping_nms_rad * velocity_rad_s
        damped_nm, self._damping_nm = damping_nm - self._damping_nm, damping_nm
        feedback_nm = self.gains.proportional * rise_nm + self.gains.integral_per_s * self.tick_s * torque_nm
        return share * boost * feedback_nm + damped_nm

    def _share(self, position_rad: float) -> float:
        self._reach_rad = max(self._reach_rad, abs(position_rad - self._began_rad))
        if self.slow < 1.0:
            self._known_s += self.tick_s * (1 - exp(-self._reach_rad / self.turn_rad))
        return max(self.slow, self.settles_s / (self.settles_s + self._known_s)) if self._known_s else 1.0

    def _sticking(self, position_rad: float) -> float:
        return exp(-abs(position_rad - self._turned_at_rad) / self.turn_rad)

    def _follow(self, position_rad: float) -> None:
        direction = self._farthest_rad - self._turned_at_rad
        beyond = position_rad - self._farthest_rad
        if direction * beyond >= 0:
            self._farthest_rad = position_rad
        elif abs(beyond) > self.play_rad:
            self._turned_at_rad, self._farthest_rad = self._farthest_rad, position_rad


def settles_s(gains: TorqueGains, calibration: LoadCalibration) -> float:
    """The time constant with which a standing torque at the port decays under ``gains``.

    One over that is the integral gain times what of a standing command the port sees. While both contacts slide that
    is the actuator's share of the damping, while one sticks all of it: all of it is reckoned with.
    """
    return 1.0 / (gains.integral_per_s * calibration.torque_gain)
