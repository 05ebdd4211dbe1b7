"""Samples of made-up shafts, tick by tick, for the plausibility checks."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import cos, sin

from norton_bench.guard.check import Check, Commands
from norton_bench.sample import Sample

TICK_NS = 1_000_000
START_NS = 5_000_000_000
AGE_NS = 400_000
NOTHING = Commands(0.0, 0.0)

Change = Callable[[Sample], Sample]


def turning(tick: int, *, amplitude_rad: float = 1.0, rate_rad_s: float = 10.0) -> Sample:
    """Both machines swing together; every reading is new, and true when it arrived."""
    now_ns = START_NS + tick * TICK_NS
    phase = rate_rad_s * (now_ns - START_NS - AGE_NS) * 1e-9
    position_rad, velocity_rad_s = amplitude_rad * sin(phase), amplitude_rad * rate_rad_s * cos(phase)
    return Sample(
        now_ns,
        torque_nm=0.01 * sin(phase) + 1e-6 * (tick % 7),
        torque_age_ns=AGE_NS,
        torque_new=True,
        position_rad=position_rad,
        velocity_rad_s=velocity_rad_s,
        motion_age_ns=AGE_NS,
        motion_new=True,
        load_position_rad=position_rad,
        load_velocity_rad_s=velocity_rad_s,
        load_motion_age_ns=AGE_NS,
        load_motion_new=True,
        current_a=0.0,
        current_new=True,
        load_current_a=0.0,
        load_current_new=True,
        torque_count=1,
        motion_count=1,
        load_motion_count=1,
    )


def resting(tick: int) -> Sample:
    return turning(tick, amplitude_rad=0.0)


@dataclass(frozen=True)
class Verdict:
    """``tick`` is the one at which the check found fault; None where it did not."""

    tick: int | None
    said: str = ""


def ask(check: Check, samples: Iterable[Sample], sent: Callable[[int], Commands] = lambda _: NOTHING) -> Verdict:
    """Begin, and go on until the check finds fault."""
    for tick, sample in enumerate(samples):
        if tick == 0:
            check.begin(sample)
        said = check.fault(sample, sent(tick))
        if said is not None:
            return Verdict(tick, said)
    return Verdict(None)


def from_tick(tick: int, change: Change, motion: Callable[[int], Sample] = turning, ticks: int = 1000) -> list[Sample]:
    """``motion``, of which ``change`` is made from ``tick`` on."""
    return [change(motion(k)) if k >= tick else motion(k) for k in range(ticks)]
