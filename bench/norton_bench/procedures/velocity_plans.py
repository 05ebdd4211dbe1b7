"""Commands for a servo that holds a velocity, and motions imposed on it: as large as the limits allow.

It is a damper about its command: its torque is its gain times what the command is ahead of the shaft. So a command
rides on an imposed motion, and is ahead of it by no more than leaves the servo below its limit: then the gain and the
viscous damping are told apart, for what is ahead and what moves have nothing to do with each other. All begin and end
at zero.
"""

from collections.abc import Iterator

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.excitations import (
    SHARE,
    Sized,
    SizedPush,
    bounds_of,
    imposed_multisine,
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
from norton_bench.procedures.waves import Motion, highest_hz, multisine, ramp, sine_motion, velocity_steps

# Of the velocity limit: room for a command that is ahead.
MOTION_SHARE = 0.5
SPEED_SHARES = (0.1, -0.1, 0.4, -0.4, 1.0, -1.0)
AHEAD_SHARES = (-1.0, -0.4, 0.0, 0.4, 1.0)
CHANGE_S, DWELL_S = 0.15, 0.35
LOW_HZ = 0.2
SHAKEN_BY = 1.5  # times what would turn the servo as fast as a command: most of it is too fast for that
LIMIT_MOTION = 0.25  # of the error at which the limit should be: the motion under which it is looked for


def imposed_stretches(
    known: Knowledge, duration_s: float, seed: int, loops: tuple[tuple[float, float, int], ...]
) -> Iterator[tuple[str, Sized]]:
    """Commands and motions to impose, each with its name: both together, a command at standstill, speeds with a command
    ahead of each, and motions with none.

    ``loops`` are small ones: amplitude [rad], frequency [Hz], cycles.
    """
    tick_s, bounds, size = known.tick_s, bounds_of(known), room_for(known.rig)
    motion = imposed_multisine(known, MOTION_SHARE, duration_s, seed)
    ahead = size * _multisine(known, duration_s, seed + 1)
    yield "multisine", imposed_within(bounds, motion.velocity_rad_s + ahead, motion)
    ahead = size * _multisine(known, (HELD_TOO - 1.0) * duration_s, seed + 2)
    still = np.zeros(len(ahead))
    yield "held", imposed_within(bounds, ahead, Motion(still, still, still))
    speeds = MOTION_SHARE * known.rig.limits.velocity_rad_s * np.array(SPEED_SHARES)
    steps = velocity_steps(speeds, CHANGE_S, DWELL_S, tick_s)
    for share in AHEAD_SHARES:
        ahead, rise = np.full(len(steps.velocity_rad_s), share * size), ramp(0.0, share * size, CHANGE_S, tick_s)
        ahead[: len(rise)], ahead[-len(rise) :] = rise, rise[::-1]
        yield f"speeds {share * size:+.3g}", imposed_within(bounds, steps.velocity_rad_s + ahead, steps)
    for amplitude_rad, frequency_hz, cycles in loops:
        loop = sine_motion(amplitude_rad, frequency_hz, cycles, tick_s)
        name = f"loop {amplitude_rad * 1e3:.3g} mrad at {frequency_hz:g} Hz"
        # At a command of zero the loop would hold against so small a motion better than the load imposes it.
        yield name, imposed_within(bounds, loop.velocity_rad_s, loop)


def shaken(known: Knowledge, duration_s: float, seed: int) -> SizedPush:
    """Load torque and command [rad/s], both up to fast changes: the lag of the amplifier and the inertia show
    where a load that follows a motion hardly gets to. The servo keeps the shaft from running away."""
    size = room_for(known.rig)
    load, command = (_multisine(known, duration_s, each, low_hz=1.0) for each in (seed, seed + 1))
    torque_nm = min(servo_of(known.rig).gain * SHAKEN_BY * size, SHARE * known.rig.limits.load_torque_nm)
    return pushed_within(bounds_of(known), torque_nm * load, size * command)


def limit_stretch(known: Knowledge) -> tuple[FloatArray, Motion] | None:
    """A command and a motion between which the servo reaches its limit; None where the rig does not let it, or nobody
    knows where that is."""
    servo, limits = servo_of(known.rig), known.rig.limits
    wanted = BEYOND_LIMIT * servo.greatest_error
    fastest_rad_s = LIMIT_MOTION * servo.greatest_error
    if wanted > greatest_goal(known.rig) or servo.greatest_nm > SHARE * min(limits.torque_nm, limits.load_torque_nm):
        return None
    amplitude_rad = fastest_rad_s / (2 * np.pi * LIMIT_HZ)
    if amplitude_rad > SHARE * limits.position_rad or fastest_rad_s > MOTION_SHARE * limits.velocity_rad_s:
        return None
    motion = sine_motion(amplitude_rad, LIMIT_HZ, LIMIT_CYCLES, known.tick_s)
    # Against the motion, all the time but while it turns its side.
    return -wanted * np.tanh(motion.velocity_rad_s / (0.1 * fastest_rad_s)), motion


def imposed_s(duration_s: float) -> float:
    """How long the stretches take, but for the loops."""
    speeds_s = len(AHEAD_SHARES) * (len(SPEED_SHARES) + 1) * (CHANGE_S + DWELL_S)
    return (HELD_TOO + 0.5 * SHAKES) * duration_s + speeds_s + LIMIT_CYCLES / LIMIT_HZ


def _multisine(known: Knowledge, duration_s: float, seed: int, low_hz: float = LOW_HZ) -> FloatArray:
    return multisine(duration_s, known.tick_s, low_hz=low_hz, high_hz=highest_hz(known.tick_s), seed=seed, slope=-0.25)
