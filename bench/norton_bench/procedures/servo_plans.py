"""Goals for a servo that holds a position, and motions imposed on it: as large as its limit and the rig's limits allow.

It is a spring about its goal: where the shaft stands away from that by the error of its limit, its torque grows no
more. All but the stretch that looks for the limit stay below it. Every goal and motion begins and ends at zero.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.excitations import (
    SHARE,
    Sized,
    SizedPush,
    bounds_of,
    free_within,
    imposed_within,
    pushed_within,
)
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.servo_room import (
    BEYOND_LIMIT,
    HELD_TOO,
    LIMIT_CYCLES,
    LIMIT_HZ,
    SHAKES,
    greatest_goal,
    room_for,
    servo_of,
)
from norton_bench.procedures.waves import Motion, highest_hz, hold, multisine, multisine_motion, ramp, sine_motion

# A goal that the free shaft follows leaves an error of a fraction of itself; above this frequency it does not follow.
FOLLOWED_HZ = 60.0
LOW_HZ = 0.2
MOVE_S, BACK_S = 0.25, 1.0  # from one level to the next, and from and to zero
SLOW_HZ = (0.15, 1.0)
SHAKEN_BY = 2.5  # times what would turn the servo as far as a goal: most of it is too fast for that
HIGHEST_MOTION_HZ = 40.0
# To and fro at a constant goal: frequency, cycles, and share of the greatest motion.
SWINGS = ((0.5, 4, 1.0), (2.0, 6, 1.0), (8.0, 16, 0.5))


def goal_span(known: Knowledge) -> float:
    """The greatest goal to use [rad]."""
    return greatest_goal(known.rig)


def free_goals(known: Knowledge, levels: int, dwell_s: float, duration_s: float) -> Iterator[tuple[str, FloatArray]]:
    """Goals for a shaft at zero torque, each with its name: steps up and down, then a multisine."""
    span_rad, tick_s = goal_span(known), known.tick_s
    steps = np.linspace(-span_rad, span_rad, levels)
    for name, goals in (("rising", steps), ("falling", steps[::-1])):
        parts = [ramp(0.0, goals[0], BACK_S, tick_s), hold(goals[0], dwell_s, tick_s)]
        for before, after in pairwise(goals):
            parts += [ramp(before, after, MOVE_S, tick_s), hold(after, dwell_s, tick_s)]
        command = np.concatenate([*parts, ramp(goals[-1], 0.0, BACK_S, tick_s)])
        yield f"staircase {name}", free_within(bounds_of(known), command) * command
    yield "multisine", free_goal(known, duration_s, seed=1)


def free_goal(known: Knowledge, duration_s: float, seed: int) -> FloatArray:
    """A multisine of goals for a shaft at zero torque."""
    command = (
        goal_multisine(known, duration_s, seed, room_for(known.rig)) + travel(known, duration_s, seed + 1).position_rad
    )
    return free_within(bounds_of(known), command) * command


def travel(known: Knowledge, duration_s: float, seed: int) -> Motion:
    """A slow motion as far as the goals reach, to go with the goal: what changes with the position, such as cogging, is
    then no stiffness."""
    motion = multisine_motion(
        duration_s, known.tick_s, low_hz=SLOW_HZ[0], high_hz=SLOW_HZ[1], seed=seed, slope=-0.5, lines=12
    )
    furthest_rad = float(np.max(np.abs(motion.position_rad)))
    size_rad = max(min(goal_span(known), SHARE * known.rig.limits.position_rad) - room_for(known.rig), 0.0)
    return motion.scaled(min(size_rad / furthest_rad, 0.2 * known.rig.limits.velocity_rad_s))


def goal_multisine(known: Knowledge, duration_s: float, seed: int, size_rad: float) -> FloatArray:
    """As far as ``size_rad``; what the shaft does not follow has little of it."""
    wave = multisine(duration_s, known.tick_s, low_hz=LOW_HZ, high_hz=FOLLOWED_HZ, seed=seed, slope=-0.4)
    return size_rad * wave


def motion_multisine(known: Knowledge, duration_s: float, seed: int, size_rad: float) -> Motion:
    """As far as ``size_rad``, and as fast as half of the velocity limit at most."""
    motion = multisine_motion(duration_s, known.tick_s, low_hz=0.3, high_hz=HIGHEST_MOTION_HZ, seed=seed, slope=-0.2)
    furthest_rad = float(np.max(np.abs(motion.position_rad)))
    return motion.scaled(min(size_rad / furthest_rad, 0.5 * known.rig.limits.velocity_rad_s))


def imposed_stretches(
    known: Knowledge, duration_s: float, seed: int, loops: tuple[tuple[float, float, int], ...]
) -> Iterator[tuple[str, Sized]]:
    """Goals and motions to impose, each with its name: both together, a goal alone, and motions at a constant goal.

    ``loops`` are small ones: amplitude [rad], frequency [Hz], cycles.
    """
    tick_s, bounds, size_rad = known.tick_s, bounds_of(known), room_for(known.rig)
    motion = motion_multisine(known, duration_s, seed, size_rad)
    command = goal_multisine(known, duration_s, seed + 1, size_rad)
    yield "multisine", imposed_within(bounds, command, motion)
    command = goal_multisine(known, (HELD_TOO - 1.0) * duration_s, seed + 2, size_rad)
    still = np.zeros(len(command))
    yield "held", imposed_within(bounds, command, Motion(still, still, still))
    swings = tuple((share * size_rad, frequency_hz, cycles) for frequency_hz, cycles, share in SWINGS)
    for amplitude_rad, frequency_hz, cycles in (*swings, *loops):
        loop = sine_motion(amplitude_rad, frequency_hz, cycles, tick_s)
        name = f"loop {amplitude_rad * 1e3:.3g} mrad at {frequency_hz:g} Hz"
        yield name, imposed_within(bounds, np.zeros(len(loop.position_rad)), loop)


def shaken(known: Knowledge, duration_s: float, seed: int) -> SizedPush:
    """Load torque and goal [rad], both up to fast changes: the lag of the amplifier, inertia and damping show
    where a load that follows a motion hardly gets to. The servo is the spring that keeps the shaft in its place."""
    tick_s, size_rad = known.tick_s, room_for(known.rig)
    load, goal = (
        multisine(duration_s, tick_s, low_hz=1.0, high_hz=highest_hz(tick_s), seed=each, slope=-0.25)
        for each in (seed, seed + 1)
    )
    torque_nm = min(servo_of(known.rig).gain * SHAKEN_BY * size_rad, SHARE * known.rig.limits.load_torque_nm)
    goals = size_rad * goal + travel(known, duration_s, seed + 2).position_rad
    return pushed_within(bounds_of(known), torque_nm * load, goals)


def limit_stretch(known: Knowledge) -> tuple[FloatArray, Motion] | None:
    """A goal and a motion between which the servo reaches its limit; None where the rig does not let it, or nobody
    knows where that is."""
    servo, limits = servo_of(known.rig), known.rig.limits
    wanted_rad = BEYOND_LIMIT * servo.greatest_error
    amplitude_rad = max(wanted_rad - goal_span(known), 0.25 * servo.greatest_error)
    if not np.isfinite(wanted_rad) or servo.greatest_nm > SHARE * min(limits.torque_nm, limits.load_torque_nm):
        return None
    if amplitude_rad > min(SHARE * limits.position_rad, 2.0 * servo.greatest_error):
        return None
    motion = sine_motion(amplitude_rad, LIMIT_HZ, LIMIT_CYCLES, known.tick_s)
    goal_rad = min(goal_span(known), wanted_rad - 0.5 * amplitude_rad)
    # Against the motion, all the time but while it turns its side.
    side = -np.tanh(motion.position_rad / (0.1 * amplitude_rad))
    return goal_rad * side, motion


def servo_free_s(levels: int, dwell_s: float, duration_s: float) -> float:
    """How long the goals for a free shaft take."""
    return 2 * (levels * dwell_s + (levels - 1) * MOVE_S + 2 * BACK_S) + duration_s


def servo_imposed_s(duration_s: float) -> float:
    """How long the stretches take, but for the loops."""
    return (
        (HELD_TOO + 0.5 * SHAKES) * duration_s
        + sum(cycles / frequency_hz for frequency_hz, cycles, _ in SWINGS)
        + (LIMIT_CYCLES / LIMIT_HZ)
    )
