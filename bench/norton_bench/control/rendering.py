"""Which laws a bench can render: whether the load is stable that acts a virtual body, and how passive its port is.

    M dv/dt + B (v − v_ref) + K (x − x_ref) = τ_port

A law is tried as it runs: the code that turns an estimate into a command is asked what it makes of every number that it
depends upon, and the answers are the matrix of a linear controller. Poles of the closed loop are computed with the
delays and the sampling of the bench, on every bench that the calibration may mean.

The other certificate holds for any actuator: the impedance that the port shows, Z = τ/ω, has a negative real part at
some frequencies, because the load follows its body late. With an actuator that is passive and has at least that much
damping of its own, the bench is stable (Colgate and Hogan, International Journal of Control 48, 1988).
"""

from cmath import phase
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, isnan, log, nan, pi, sqrt

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.control.admittance import FeedForward, Reference, VirtualBody, between, followed
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.design import (
    Tracking,
    actuator_inertias,
    design_tracking,
    miscalibrated,
    nominal_bench,
    of_inertias,
    sliding_benches,
    sticking_benches,
    unevenly_read,
)
from norton_bench.control.observer import WIDTH, port_torque_nm
from norton_bench.control.regulator import POSITION, VELOCITY, SampledBench
from norton_bench.control.robustness import (
    Control,
    control_response,
    corrected,
    observing,
    sizes,
    unstable_pole,
)
from norton_bench.control.torque_loop import KNOWN_TORQUE, with_contact
from norton_bench.errors import ExperimentError
from norton_bench.sample import Target
from norton_bench.segments import Admittance

# The nearest law that can be rendered is looked for in so many steps of so much: over a factor of 1000.
STEP, STEPS = 1.2, 40
COARSE_STEPS = 10
# Heavier actuators are tried in steps of so much; one so many times as heavy as load and actuator does not move.
HEAVIER, HELD = 1.4, 50.0
# A contact that sticks is a spring up to this torque [N m]: as good as always.
NEVER_SLIDES_NM = 1e4
# From one law to another, those at these shares of the way are looked at, too.
ON_THE_WAY = (0.25, 0.5, 0.75)
BODY, PATH, FEED = 2, 3, 2  # what the running law remembers beside its shares


@dataclass(frozen=True)
class Rendering:
    """What a law comes to on a bench.

    ``unstable`` names on what it is not stable, ``oscillates_hz`` the frequency that grows there; empty and NaN where
    it can be rendered. It is stable with actuators of ``lightest_kgm2`` to ``heaviest_kgm2``, infinite where also with
    one that is held. Only then, and without a wall, is ``needed_damping_nms_rad`` the least damping that a passive
    actuator must have to be stable on this port, whatever else it is, and ``needed_at_hz`` the frequency that asks for
    it; else both are NaN.
    """

    law: Admittance
    unstable: str = ""
    oscillates_hz: float = nan
    lightest_kgm2: float = nan
    heaviest_kgm2: float = nan
    needed_damping_nms_rad: float = nan
    needed_at_hz: float = nan

    @property
    def words(self) -> str:
        """With which actuators a law is stable."""
        where = "" if self.law.wall_rad is None else "before the wall and behind it "
        words = f"{where}{self.law.words} is stable with an actuator of {self.lightest_kgm2:.2g} kg*m^2"
        if self.heaviest_kgm2 < inf:
            return f"{words} to {self.heaviest_kgm2:.2g}, whose friction slides or sticks; not with one that is held"
        words = f"{words} or more, whose friction slides or sticks, and with one that is held"
        if isnan(self.needed_damping_nms_rad):
            return words
        needed = (
            f"{self.needed_damping_nms_rad:.2g} N*m*s/rad of damping itself, which {self.needed_at_hz:.3g} Hz ask for"
        )
        return f"{words}; with any other passive one that has {needed}"


@lru_cache(maxsize=256)
def rendering(calibration: LoadCalibration, tick_s: float, law: Admittance) -> Rendering:
    """The certificate of a law with a body of its own: with a wall, of the law before it and of that behind it.

    Raises ExperimentError where no feedback follows any motion, and for a wall with nothing that moves before it.
    """
    if law.wall_rad is not None:
        return _beside_a_wall(calibration, tick_s, law)
    laws = _Laws(calibration, _tracking(calibration, tick_s), law, tick_s)
    unstable = laws.unstable()
    if unstable is not None:
        name, pole = unstable
        return Rendering(law, name, abs(phase(pole)) / (2 * pi * tick_s))
    result = Rendering(law, lightest_kgm2=actuator_inertias(calibration)[0], heaviest_kgm2=laws.heaviest_kgm2())
    if result.heaviest_kgm2 < inf:
        return result
    needed_damping_nms_rad, needed_at_hz = laws.needed_damping()
    return replace(result, needed_damping_nms_rad=needed_damping_nms_rad, needed_at_hz=needed_at_hz)


def _beside_a_wall(calibration: LoadCalibration, tick_s: float, law: Admittance) -> Rendering:
    behind = replace(law, wall_rad=None)
    before = replace(behind, stiffness_nm_rad=0.0)
    if not before.has_body:
        raise ExperimentError(f"this bench cannot render {law.words}: before the wall there is no mass and no damping")
    sides = [rendering(calibration, tick_s, each) for each in (before, behind)]
    for each in sides:
        if each.unstable:
            return replace(each, law=law)
    heaviest_kgm2 = min(each.heaviest_kgm2 for each in sides)
    return Rendering(law, lightest_kgm2=sides[0].lightest_kgm2, heaviest_kgm2=heaviest_kgm2)


def require_rendered(calibration: LoadCalibration, tick_s: float, law: Admittance, *, offers: bool = True) -> Rendering:
    """The certificate. Raises ExperimentError where the law cannot be rendered; with ``offers`` it names the nearest
    ones that can, which takes some seconds."""
    result = rendering(calibration, tick_s, law)
    if not result.unstable:
        return result
    raise ExperimentError(
        f"this bench cannot render {law.words}: with {result.unstable} the load would swing at "
        f"{result.oscillates_hz:.2g} Hz and not come to rest"
        + (f"; {_nearest(calibration, tick_s, law)}" if offers else "")
    )


def require_change(calibration: LoadCalibration, tick_s: float, before: Admittance, after: Admittance) -> None:
    """Raises ExperimentError where a body that goes from one law to the other would go by one that cannot be rendered.

    Nothing is on the way where no body goes on: at zero torque, or where a wall comes, goes or moves.
    """
    if not (before.has_body and after.has_body and before.wall_rad == after.wall_rad):
        return
    for law in (between(before, after, share) for share in ON_THE_WAY):
        try:
            require_rendered(calibration, tick_s, law, offers=False)
        except ExperimentError as error:
            way = f"on the way from {before.words} to {after.words}"
            raise ExperimentError(f"{way}: {error}; go there by another law") from None


def rendering_is_stable(calibration: LoadCalibration, tick_s: float, law: Admittance) -> bool:
    """Whether a law without a wall is stable on every bench that the calibration may mean."""
    return _Laws(calibration, _tracking(calibration, tick_s), law, tick_s).unstable() is None


def body_control(
    calibration: LoadCalibration, tracking: Tracking, law: Admittance, tick_s: float, *, sticks: bool = False
) -> Control:
    """Observer, virtual body and regulator as one linear controller; ``sticks``: the load's friction is a spring."""
    observer, contact = tracking.observer, np.zeros(WIDTH)
    if sticks:
        contact[POSITION] = calibration.presliding_stiffness_nm_rad
        contact[VELOCITY] = calibration.presliding_damping_nms_rad + calibration.viscous_damping_nms_rad
        observer = with_contact(observer, KNOWN_TORQUE, contact, tick_s)
    running = _Running(calibration, tracking, law, tick_s, contact).matrix()
    body, commands = sizes(observer)
    seen = corrected(observer)
    on_state, on_commands, on_memory = np.split(running, [WIDTH, WIDTH + observer.whole + 2], axis=1)
    rows = np.zeros((len(running), body + commands + on_memory.shape[1]))
    rows[:, : body + commands] = on_state @ seen[:WIDTH]
    rows[:, body : body + on_commands.shape[1]] += on_commands
    rows[:, body + commands :] = on_memory
    entries = on_state @ observer.gain[:WIDTH]
    return observing(observer, seen, rows[0], entries[0], rows[1:], entries[1:])


@dataclass(frozen=True)
class _Running:
    """The law as it runs, from the state at a tick, the last commands and what it remembers, to the next command and
    what it remembers then."""

    calibration: LoadCalibration
    tracking: Tracking
    law: Admittance
    tick_s: float
    contact: FloatArray  # the load's friction over the state, (WIDTH,); zero where it slides: then it stands still

    def matrix(self) -> FloatArray:
        """(1 + memory, WIDTH + commands + memory), column by column: the law is linear."""
        whole = self.tracking.observer.whole
        size = WIDTH + (whole + 2) + (BODY + PATH + FEED + whole + 1)
        return np.stack([self._next(unit) for unit in np.eye(size)], axis=1)

    def _next(self, given: FloatArray) -> FloatArray:
        feed = FeedForward.of(self.calibration, self.tick_s, inf)
        reference = Reference.of(self.calibration, self.tick_s)
        state, commands, remembered, path, delivered, shares = np.split(
            given, np.cumsum([WIDTH, feed.whole + 2, BODY, PATH, FEED])
        )
        body = VirtualBody(self.law, self.tick_s)
        body.begin(float(remembered[0]), float(remembered[1]))
        feed.delivered[:], feed.shares[0], feed.shares[1:] = delivered, shares[0], shares
        reference.path[:] = path
        target = body.step(port_torque_nm(self.calibration, state), Target())
        wish_nm = followed(
            state[None].copy(),
            np.array([self.contact[POSITION] * state[POSITION], 0.0]),
            commands.copy(),
            np.array([0.0, NEVER_SLIDES_NM, self.contact[POSITION], self.contact[VELOCITY]]),
            feed,
            reference,
            self.tracking.regulator,
            target,
            target,
        )
        feed.advance()
        now = [body.position_rad, body.velocity_rad_s]
        return np.concatenate([[wish_nm], now, reference.path, feed.delivered, feed.shares[1:]])


@dataclass(frozen=True)
class _Laws:
    """A law on all benches that the calibration may mean: while the load's contact slides, and while it sticks."""

    calibration: LoadCalibration
    tracking: Tracking
    law: Admittance
    tick_s: float

    def unstable(self) -> tuple[str, complex] | None:
        """The first bench on which something grows, and its pole; None where there is none."""
        slides, sticks = self._control(sticks=False), self._control(sticks=True)
        for name, benches in self._benches():
            for bench in benches:
                control = sticks if bench.load_spring_nm_rad > 0.0 else slides
                pole = unstable_pole(bench, control, self.tick_s)
                if pole is not None:
                    return name, pole
        return None

    def _benches(self) -> Iterator[tuple[str, Iterator[SampledBench]]]:
        """Those on which the law must be stable, with what they are."""
        c, tick_s = self.calibration, self.tick_s
        lightest, heaviest = actuator_inertias(c)
        yield "an actuator that slides", sliding_benches(c, tick_s)
        yield "encoders that are read at different times", unevenly_read(c, tick_s)
        yield (
            "an actuator that sticks",
            (
                each
                for bench in sticking_benches(c, tick_s)
                for inertia_kgm2 in (lightest, bench.actuator_inertia_kgm2, heaviest)
                for each in miscalibrated(replace(bench, actuator_inertia_kgm2=inertia_kgm2), tick_s)
            ),
        )

    def heaviest_kgm2(self) -> float:
        """The greatest inertia of an actuator up to which it is stable; infinite where also with one that is held."""
        c, nominal = self.calibration, nominal_bench(self.calibration, self.tick_s)
        slides, heaviest = self._control(sticks=False), actuator_inertias(c)[1]
        held_kgm2 = HELD * max(heaviest, c.inertia_kgm2)
        while heaviest < held_kgm2:
            heavier = min(HEAVIER * heaviest, held_kgm2)
            if any(unstable_pole(each, slides, self.tick_s) for each in of_inertias(nominal, (heavier,), self.tick_s)):
                return heaviest
            heaviest = heavier
        return inf

    def needed_damping(self) -> tuple[float, float]:
        """By how much the real part of the port's impedance is negative at worst, and at which frequency [Hz]."""
        c, nominal = self.calibration, nominal_bench(self.calibration, self.tick_s)
        stuck = replace(
            nominal, load_spring_nm_rad=c.presliding_stiffness_nm_rad, load_damper_nms_rad=c.presliding_damping_nms_rad
        )
        frequencies = _dense(nominal, self.tick_s)
        worst, at = 0.0, nan
        for bench, sticks in ((nominal, False), (stuck, True)):
            response = control_response(self._control(sticks=sticks), frequencies)
            for each in miscalibrated(bench, self.tick_s):
                shown = port_impedance(each, response, frequencies, self.tick_s).real
                if -np.min(shown) > worst:
                    worst, at = -float(np.min(shown)), float(frequencies[np.argmin(shown)])
        return worst, at / (2 * pi * self.tick_s)

    def _control(self, *, sticks: bool) -> Control:
        return body_control(self.calibration, self.tracking, self.law, self.tick_s, sticks=sticks)


def _dense(bench: SampledBench, tick_s: float) -> FloatArray:
    """Frequencies [rad per tick] so near each other that no resonance lies between, to twice that of the load on the
    sensor's spring, and no less than half the loop's rate; about that resonance the nearest."""
    resonance = tick_s * sqrt(bench.stiffness_nm_rad / bench.load_inertia_kgm2)
    about = resonance * np.linspace(0.5, 2.0, 600)
    return np.unique(np.concatenate([np.linspace(1e-3, max(2.0 * resonance, pi), 600), about]))


def port_impedance(bench: SampledBench, response: ComplexArray, frequencies: FloatArray, tick_s: float) -> ComplexArray:
    """τ/ω at the port [N m s/rad] at ``frequencies`` [rad per tick], whatever the actuator is; shape (n,).

    ``response`` (n, 3) is the controller's. The load, the sensor and the drive are continuous, the controller is
    sampled and its command is held; what sampling folds down is left out.
    """
    s = 1j * frequencies / tick_s
    reads = response * np.exp(-s[:, None] * np.array(bench.delays_s()))
    held = -np.expm1(-s * tick_s) / (s * tick_s) * np.exp(-s * bench.command_delay_s)
    drive = held * bench.gain * bench.bandwidth_rad_s / (s + bench.bandwidth_rad_s)
    spring = bench.stiffness_nm_rad + bench.damping_nms_rad * s
    load = bench.load_inertia_kgm2 * s**2 + bench.load_damper_nms_rad * s + bench.load_spring_nm_rad
    on_torque, on_load, on_actuator = (drive * reads.T[output] for output in range(3))
    # Of one radian of the actuator's: load · θ = (1 + on_torque) spring (1 − θ) + on_load θ + on_actuator
    turned = ((1 + on_torque) * spring + on_actuator) / (load + (1 + on_torque) * spring - on_load)
    return np.asarray(spring * (1 - turned) / s)


@lru_cache(maxsize=16)
def _tracking(calibration: LoadCalibration, tick_s: float) -> Tracking:
    return design_tracking(calibration, tick_s)


def _nearest(calibration: LoadCalibration, tick_s: float, law: Admittance) -> str:
    """What one change of the law, each by itself, would make it one that can be rendered."""
    inertia_kgm2 = calibration.inertia_kgm2

    def renders(changed: Admittance) -> bool:
        return not rendering(calibration, tick_s, changed).unstable

    changes: tuple[Iterable[tuple[str, Admittance]], ...] = (
        (
            (f"a mass of {value:g} kg*m^2", replace(law, mass_kgm2=value))
            for value in _about(law.mass_kgm2, inertia_kgm2)
        ),
        (
            (f"a damping of {value:g} N*m*s/rad", replace(law, damping_nms_rad=value))
            for value in _about(law.damping_nms_rad, inertia_kgm2 / tick_s)
        ),
        (
            (f"a stiffness of {value:g} N*m/rad", replace(law, stiffness_nm_rad=value))
            for value in (_about(law.stiffness_nm_rad, 0.0) if law.stiffness_nm_rad else ())
        ),
    )
    found = [next((words for words, changed in each if renders(changed)), None) for each in changes]
    if any(found):
        return f"it can with {' or '.join(filter(None, found))}, the rest as it is"
    both = next((each for each in _of_any_mass(law, inertia_kgm2, tick_s) if renders(each)), None)
    return "no other single value would do" + (f"; it can render {both.words}" if both else "")


def _of_any_mass(law: Admittance, inertia_kgm2: float, tick_s: float) -> Iterator[Admittance]:
    """From the load's own inertia on, the mass nearest to the law's first, with more and more damping; coarsely, as it
    only shows a way."""
    masses_kgm2 = [inertia_kgm2 * 2.0**power for power in range(COARSE_STEPS)]
    for mass_kgm2 in sorted(masses_kgm2, key=lambda mass_kgm2: abs(log(mass_kgm2 / (law.mass_kgm2 or inertia_kgm2)))):
        for power in range(COARSE_STEPS):
            damping_nms_rad = inertia_kgm2 / tick_s * 2.0 ** (power - COARSE_STEPS // 2)
            if damping_nms_rad > law.damping_nms_rad:
                yield replace(law, mass_kgm2=rounded(mass_kgm2), damping_nms_rad=rounded(damping_nms_rad))


def _about(value: float, scale: float) -> Iterator[float]:
    """More than ``value`` and less, step by step farther away; from far below ``scale`` on where it is zero. Rounded as
    a sentence says it, so that just this is tried."""
    start = value or scale / STEP ** (STEPS // 2)
    for n in range(1, STEPS):
        yield rounded(start * STEP**n)
        if value:
            yield rounded(start / STEP**n)


def rounded(value: float) -> float:
    """As a sentence or a table has it, so that just this is tried."""
    return float(f"{value:.2g}")
