"""The admittance law at the load drive: one call a tick turns a sample into the load torque to command.

    M dv/dt + B (v − v_ref) + K (x − x_ref) = τ_port

Zero torque and prescribed motion are its two ends; what lies between must be one of the laws that the bench can render
(:mod:`norton_bench.control.rendering`). See ``docs/control.md``.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from math import exp, nan

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control import core
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.design import TorqueGains, Tracking, design_torque_loop, design_tracking
from norton_bench.control.observer import FREE_RATE, Estimator
from norton_bench.control.regulator import AMPLIFIER, FREE, LOAD, POSITION, VELOCITY, Regulator
from norton_bench.control.torque_loop import Anticipation, TorqueLoop, design_anticipation, settles_s
from norton_bench.sample import Sample, Target
from norton_bench.segments import GLIDE_S, ZERO_TORQUE, Admittance

# Contacts are taken to slide after so many of the load's own presliding lengths: the actuator's may be longer.
SLIDING_LENGTHS = 30.0
PLAY_COUNTS = 4.0  # this many encoder counts back are a turn
# The regulator's state is laid out as the observer's begins; these are measured from the reference.
PLACES = np.array([POSITION, VELOCITY, AMPLIFIER, FREE, LOAD])
FORESEEN = np.array([VELOCITY, FREE, FREE_RATE])


@dataclass(frozen=True)
class Design:
    """Observers and gains for one load; ``anticipation`` where one that knows the actuator's friction has margins."""

    tracking: Tracking
    gains: TorqueGains
    anticipation: Anticipation | None


@lru_cache(maxsize=16)
def _designed(calibration: LoadCalibration, tick_s: float) -> Design:
    """Kept, as the cases of a campaign have one calibration. Raises ExperimentError as the designs do."""
    tracking = design_tracking(calibration, tick_s)
    gains = design_torque_loop(calibration, tracking.observer, tick_s)
    return Design(tracking, gains, design_anticipation(calibration, gains, tick_s))


@dataclass
class AdmittanceController:
    """Each tick: ``update`` (or ``observe`` while something else decides), then ``note_sent`` with what was sent.

    Construction designs the gains, unless there is a ``design`` already, and takes a second or two. Raises
    ExperimentError where no gains keep their margins.
    """

    calibration: LoadCalibration
    tick_s: float
    torque_limit_nm: float
    design: Design | None = None
    _frees: bool = field(default=True, init=False)  # zero torque is asked for
    _rigid: bool = field(default=False, init=False)
    _leads: bool = field(default=False, init=False)  # along a free motion that was foreseen
    _goes_on: bool = field(default=False, init=False)  # and did so until now
    _anticipating: Anticipation | None = field(default=None, init=False)
    _deciding: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        c = self.calibration
        design = self.design or _designed(c, self.tick_s)
        self._tracking, self._gains, self._anticipation = design.tracking, design.gains, design.anticipation
        self._regulator, self._estimator = self._tracking.regulator, Estimator(c, self.tick_s, self._tracking.observer)
        self._inertias_kgm2 = np.array([c.inertia_kgm2, c.actuator_inertia_kgm2 or c.inertia_kgm2])
        self._feed = FeedForward.of(c, self.tick_s, self.torque_limit_nm)
        self._reference = Reference.of(c, self.tick_s)
        self._body = VirtualBody(ZERO_TORQUE, self.tick_s)
        self._choose(None)
        self._compile()
        self._last_target = Target()

    @property
    def lead_ticks(self) -> int:
        """How far ahead :meth:`update` wants to know the reference."""
        return self._feed.whole + 2

    def begin(
        self, sample: Sample, admittance: Admittance, *, leads: bool = False, mends_rad_s: float | None = None
    ) -> None:
        """Take over without a bump: the command continues from the last one sent.

        ``leads``: under zero torque the reference is the free motion, foreseen. It may ask for another torque at once,
        where the actuator's command jumps: by what was fed forward along such a reference before, or by what a shaft
        takes that turns at the velocity with which it begins.
        A law with a body of its own is taken as it is: `rendering.require_rendered` says whether it is stable. From one
        body to another, the body goes on, and the law changes within GLIDE_S; unless a wall comes, goes or moves.
        ``mends_rad_s``: it is foreseen so well that feedback had better be so slow; None for as quick as its margins
        allow.
        """
        self._goes_on, self._leads = leads and self._leads and self._deciding, leads
        acts = self._deciding and not self._frees and not self._rigid
        same_body = acts and admittance.has_body and admittance.wall_rad == self._body.admittance.wall_rad
        if same_body:
            self._body.become(admittance)
        elif admittance.has_body:
            self._body = VirtualBody(admittance, self.tick_s)
        self._frees, self._rigid, self._deciding = admittance == ZERO_TORQUE, admittance.rigid, same_body
        self._choose(self._anticipation if self._frees and not leads else None)
        if mends_rad_s is not None:
            self._loop.settles_s = settles_s(self._gains, self.calibration)
            self._loop.slow = min(mends_rad_s * self._loop.settles_s, 1.0)

    def observe(self, sample: Sample) -> None:
        """Keep watching while the load torque is decided elsewhere."""
        self._estimator.sense(sample)
        self._deciding = False

    def rest(self) -> None:
        """Nothing is decided any more: the drives are idle. What begins next begins where the shaft is."""
        self._deciding = False

    def update(self, sample: Sample, target: Target, ahead: Target | None = None) -> float:
        """The load torque wished [N m]; NaN where a signal is missing or is no number.

        ``target`` is the reference now, ``ahead`` that ``lead_ticks`` later; without it the reference is continued
        along its last slope. Under zero torque the reference is the motion source as far as it is known beforehand:
        its velocity and acceleration are used, its position means nothing.
        """
        if not self._estimator.sense(sample):
            self._deciding = False
            return nan
        begins, self._deciding = not self._deciding, True
        if ahead is None:
            ahead = continued(target, target if begins else self._last_target, self.lead_ticks, self.tick_s)
        if self._frees:
            wish_nm = self._zero_torque(sample, target, ahead, begins)
        elif self._rigid:
            wish_nm = self._track(target, ahead, begins)
        else:
            wish_nm = self._follow_body(target, begins)
        self._last_target = target
        return float(min(max(wish_nm, -self.torque_limit_nm), self.torque_limit_nm))

    def note_sent(self, load_torque_nm: float) -> None:
        """What the guard let through; once a tick, after ``update`` or ``observe``."""
        if self._deciding:
            self._feed.advance()
        self._estimator.advance(load_torque_nm)

    def _torque_loop(self, gains: TorqueGains) -> TorqueLoop:
        c = self.calibration
        return TorqueLoop(
            gains,
            self.tick_s,
            SLIDING_LENGTHS * c.coulomb_torque_nm / c.presliding_stiffness_nm_rad,
            PLAY_COUNTS * c.position_resolution_rad,
        )

    def _choose(self, anticipation: Anticipation | None) -> None:
        """The observer and the feedback of what is to be done."""
        gains = anticipation.gains if anticipation else self._gains
        self._anticipating, self._loop = anticipation, self._torque_loop(gains)
        observer = (anticipation or self._tracking).observer
        self._estimator.use(observer, knows_friction=anticipation is not None)

    def _compile(self) -> None:
        """Before the loop runs: compiling takes seconds. Leaves everything at zero."""
        self._track(Target(), Target(), begins=True)
        self._fed_forward(Target(), begins=True)
        if self._anticipation is not None:
            self._anticipated(self._anticipation, begins=True)
        self._feed.advance()

    def _zero_torque(self, sample: Sample, target: Target, ahead: Target, begins: bool) -> float:
        position_rad, velocity_rad_s = self._estimator.motion()
        motion = position_rad, velocity_rad_s - target.velocity_rad_s  # what is foreseen needs no damping
        if begins:
            self._loop.begin(sample.torque_nm, *motion)
        anticipation = self._anticipating
        if anticipation:
            fed_nm = self._anticipated(anticipation, begins)
        else:
            anew = begins and not self._goes_on
            if anew and self._leads:
                # What is foreseen begins with a shaft that has settled: all that it does from then on is a change, for
                # a light one, whose command ends, more than the load's friction by far.
                self._fed_forward(Target(velocity_rad_s=target.velocity_rad_s), begins=True)
            fed_nm = self._fed_forward(ahead, anew and not self._leads)
        nothing_known = not self._leads and ahead.velocity_rad_s == 0.0 and ahead.acceleration_rad_s2 == 0.0
        return fed_nm + self._loop.change_nm(sample.torque_nm, *motion, bold=nothing_known)

    def _track(self, target: Target, ahead: Target, begins: bool) -> float:
        if begins:
            self._reference.begin(ahead, self._estimator.contact_nm)
        seen = self._estimator
        return followed(
            seen.states,
            seen.contact,
            seen.commands,
            seen.friction_law,
            self._feed,
            self._reference,
            self._regulator,
            target,
            ahead,
            begins=begins,
        )

    def _follow_body(self, target: Target, begins: bool) -> float:
        if begins:
            self._body.begin(*self._estimator.motion())
        body = self._body.step(self._estimator.torque_nm(), target)
        return self._track(body, body, begins)

    def _fed_forward(self, ahead: Target, begins: bool) -> float:
        """The last command, changed as its feed-forward share changes."""
        if begins:
            self._reference.begin(ahead, 0.0)
        seen, feed, reference = self._estimator, self._feed, self._reference
        fed_nm: float = core.feed_forward(
            seen.commands,
            feed.shares,
            feed.delivered,
            feed.lag,
            reference.path,
            seen.friction_law,
            reference.inertia_kgm2,
            reference.between,
            self.tick_s,
            ahead.velocity_rad_s,
            ahead.acceleration_rad_s2,
            begins,
        )
        return fed_nm

    def _anticipated(self, anticipation: Anticipation, begins: bool) -> float:
        """The last command, changed as what the free motion will need changes."""
        seen, feed = self._estimator, self._feed
        fed_nm: float = core.anticipate(
            seen.commands,
            feed.shares,
            feed.delivered,
            feed.lag,
            seen.states,
            seen.contacts,
            seen.laws,
            self._inertias_kgm2,
            FORESEEN,
            anticipation.lead_s,
            begins,
        )
        return fed_nm


# The reference a little ahead of time, for when a command sent now has taken effect.
@dataclass
class Reference:
    """What is remembered of it; inertia and the friction of a contact are carried along its path.

    The instant is ``between`` (a share of a tick) beyond one tick before the newest that is known. ``path`` holds
    the contact's force [N m], and velocity [rad/s] and acceleration [rad/s²] of the newest instant.
    """

    inertia_kgm2: float
    between: float

    def __post_init__(self) -> None:
        self.path: FloatArray = np.zeros(3)

    @classmethod
    def of(cls, calibration: LoadCalibration, tick_s: float) -> "Reference":
        """For the load, at the instants at which its commands arrive."""
        return cls(calibration.inertia_kgm2, calibration.arrival(tick_s)[1] / tick_s)

    def begin(self, ahead: Target, contact_nm: float) -> None:
        """The contact starts out as the load's own."""
        self.path[:] = contact_nm, ahead.velocity_rad_s, ahead.acceleration_rad_s2


def followed(
    states: FloatArray,
    contact: FloatArray,
    commands: FloatArray,
    friction_law: FloatArray,
    feed: "FeedForward",
    reference: Reference,
    regulator: Regulator,
    target: Target,
    ahead: Target,
    *,
    begins: bool = False,
) -> float:
    """The load torque [N m] that follows ``target``: what is fed forward, less what the deviations ask for.

    ``states``, ``contact``, ``commands`` and ``friction_law`` as :class:`Estimator` has them.
    """
    wish_nm: float = core.track(
        states,
        contact,
        commands,
        feed.shares,
        feed.delivered,
        feed.lag,
        reference.path,
        friction_law,
        regulator.on_state,
        regulator.on_commands,
        PLACES,
        reference.inertia_kgm2,
        reference.between,
        feed.tick_s,
        target.position_rad,
        target.velocity_rad_s,
        target.acceleration_rad_s2,
        ahead.velocity_rad_s,
        ahead.acceleration_rad_s2,
        begins,
    )
    return wish_nm


def continued(target: Target, before: Target, ticks: int, tick_s: float) -> Target:
    """The reference ``ticks`` from now where nobody says: along the last slope of its acceleration."""
    slope = target.acceleration_rad_s2 - before.acceleration_rad_s2
    duration_s = ticks * tick_s
    velocity = target.velocity_rad_s + duration_s * (target.acceleration_rad_s2 + 0.5 * slope * ticks)
    return Target(target.position_rad, velocity, target.acceleration_rad_s2 + slope * ticks)


@dataclass
class VirtualBody:
    """Everything between the two ends of the law: a virtual body pulled by the port torque, for the load to follow.

    M dv/dt + B (v − v_ref) + K (x − x_ref) = τ_port

    A wall's spring acts beyond its angle alone. Integrates the law (implicit in damping and stiffness: stable for any
    of them).
    """

    admittance: Admittance
    tick_s: float
    position_rad: float = field(default=0.0, init=False)
    velocity_rad_s: float = field(default=0.0, init=False)
    _before: Admittance = field(default=ZERO_TORQUE, init=False)
    _glide_ticks_left: int = field(default=0, init=False)  # until it obeys ``admittance`` alone

    def begin(self, position_rad: float, velocity_rad_s: float) -> None:
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s

    def become(self, admittance: Admittance) -> None:
        """Obey another law from now on, by and by within GLIDE_S."""
        if admittance != self.admittance:
            self._before, self.admittance = self._law(), admittance
            self._glide_ticks_left = round(GLIDE_S / self.tick_s)

    def _law(self) -> Admittance:
        """The one that it obeys now."""
        if self._glide_ticks_left == 0:
            return self.admittance
        return between(self._before, self.admittance, 1.0 - self._glide_ticks_left * self.tick_s / GLIDE_S)

    def step(self, torque_nm: float, reference: Target) -> Target:
        """Where the body is one tick on, under ``torque_nm``."""
        self._glide_ticks_left = max(self._glide_ticks_left - 1, 0)
        a, h = self._law(), self.tick_s
        deflection_rad = a.deflection_rad(self.position_rad + h * self.velocity_rad_s - reference.position_rad)
        stiffness_nm_rad = a.stiffness_nm_rad if a.wall_rad is None or deflection_rad != 0.0 else 0.0
        pull = (
            torque_nm
            - a.damping_nms_rad * (self.velocity_rad_s - reference.velocity_rad_s)
            - stiffness_nm_rad * deflection_rad
        )
        acceleration = pull / (a.mass_kgm2 + h * a.damping_nms_rad + h * h * stiffness_nm_rad)
        self.velocity_rad_s += h * acceleration
        self.position_rad += h * self.velocity_rad_s
        return Target(self.position_rad, self.velocity_rad_s, acceleration)


def between(before: Admittance, after: Admittance, share: float) -> Admittance:
    """The law at this share of the way from one to the other."""
    values = ((1 - share) * b + share * a for b, a in zip(before.values, after.values, strict=True))
    return Admittance.of(values, after.wall_rad)


@dataclass
class FeedForward:
    """The command that makes the load's amplifier deliver a given torque, one arrival ahead.

    Inverts the amplifier's lag exactly at the instants at which commands arrive.

    ``shares`` holds the commands asked for, this tick's first; ``delivered`` is what they alone make the amplifier
    deliver at this tick, and when the next command arrives.
    """

    gain: float
    bandwidth_rad_s: float
    tick_s: float
    fraction_s: float  # how far into a tick commands arrive
    whole: int
    limit_nm: float

    def __post_init__(self) -> None:
        self.shares: FloatArray = np.zeros(self.whole + 2)
        self.delivered: FloatArray = np.zeros(2)
        # What stays of a difference over a tick, over its part before a command arrives, and over that after.
        stays, stays_before, stays_after = (
            exp(-self.bandwidth_rad_s * lasts_s)
            for lasts_s in (self.tick_s, self.fraction_s, self.tick_s - self.fraction_s)
        )
        self.lag: FloatArray = np.array([self.gain, self.limit_nm, stays, stays_before, stays_after])

    @classmethod
    def of(cls, calibration: LoadCalibration, tick_s: float, limit_nm: float) -> "FeedForward":
        """For the load's drive; ``limit_nm`` is that of a share."""
        c, (whole, fraction_s) = calibration, calibration.arrival(tick_s)
        return cls(c.torque_gain, c.amplifier_bandwidth_rad_s, tick_s, fraction_s, whole, limit_nm)

    def advance(self) -> None:
        """Let one tick pass."""
        core.pass_on(self.shares, self.delivered, self.lag)
