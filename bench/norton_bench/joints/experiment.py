"""What is done with the joints of an arm: their ports are moved about where they rest, and let go of during reaches."""

from math import floor, sqrt

import numpy as np

from norton_bench.arrays import IntArray
from norton_bench.joints.arm import JOINTS, Arm, ImpedanceSection, Reach
from norton_bench.joints.bench import JointPlan
from norton_bench.procedures.excitations import SHARE
from norton_bench.procedures.waves import Motion, hold, imposed, sines_motion, zero_torque
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

IMPEDANCE, REACH = "impedance", "reach"
# Both ports are moved alike in the first run and against each other in the second: at every frequency two motions
# that are independent of each other, each with all of the swing (Dobrowiecki and Schoukens, IEEE Trans. Instrum.
# Meas. 56, 2007).
SIGNS = (1.0, -1.0)
MOST_LINES = 16
# A first look, at so much of the swing, tells what torque the whole swing takes.
LOOK_SHARE = 0.2
LOOK, MOVED, OUT, BACK = "look", "moved", "out", "back"
SETTLE_S, FREE_S = 0.5, 2.0


def lines(section: ImpedanceSection) -> IntArray:
    """Which multiples of 1/period the motion consists of, shape (lines,): :data:`MOST_LINES` at most.

    Odd ones alone: an arm's inertia changes with its angles, and what that adds lies on even ones (Pintelon and
    Schoukens, chapter 4).
    """
    first, last = section.lowest_hz * section.period_s, section.highest_hz * section.period_s
    odd = np.arange(1, floor(last) + 1, 2)
    inside = odd[odd >= first]
    if inside.size <= MOST_LINES:
        return inside
    return np.asarray(inside[np.unique(np.round(np.geomspace(1, inside.size, MOST_LINES)).astype(np.int64)) - 1])


def motion(section: ImpedanceSection, tick_s: float, periods: int) -> Motion:
    """So many periods, between one in which the arm settles and half of one to end in, with 1 rad to either side.

    All lines have the same velocity: low ones tell the stiffness, high ones the inertia.
    """
    frequency_hz = lines(section) / section.period_s
    duration_s = (periods + 1.5) * section.period_s
    wave = sines_motion(frequency_hz, 1.0 / frequency_hz, duration_s, tick_s)
    return wave.scaled(1.0 / float(np.max(np.abs(wave.position_rad))))


def impedance(arm: Arm) -> JointPlan:
    """Both ports moved by sines about where they rest, under zero commands."""
    section, tick_s = arm.impedance, arm.tick_s
    short, long = motion(section, tick_s, 0), motion(section, tick_s, section.periods)
    swing_rad = section.swing_rad
    yield _free(arm)
    for sign in SIGNS:
        yield _still(tick_s)
        looked = yield _moved(LOOK, short, LOOK_SHARE * section.swing_rad, sign)
        swing_rad = min(swing_rad, *(_allowed_rad(section, *each) for each in zip(arm.rigs, looked, strict=True)))
    for sign in SIGNS:
        yield _still(tick_s)
        yield _moved(MOVED, long, swing_rad, sign)


def _free(arm: Arm) -> tuple[Segment, ...]:
    """Without torque, so that the friction of the loads does not hold the ports beside where they rest."""
    command = hold(0.0, FREE_S, arm.tick_s)
    return tuple(zero_torque(IMPEDANCE, "free", Use.PREPARE, command, rig) for rig in arm.rigs)


def _still(tick_s: float) -> tuple[Segment, ...]:
    return tuple(imposed(IMPEDANCE, "rest", Use.PREPARE, hold(0.0, SETTLE_S, tick_s)) for _ in JOINTS)


def _moved(name: str, wave: Motion, swing_rad: float, sign: float) -> tuple[Segment, ...]:
    command = np.zeros(len(wave.position_rad))
    use = Use.IDENTIFY if name == MOVED else Use.PREPARE
    return tuple(
        imposed(IMPEDANCE, f"{name} {sign:+g}", use, command, wave.scaled(swing_rad * each)) for each in (1.0, sign)
    )


def _allowed_rad(section: ImpedanceSection, rig: Rig, looked: Measured) -> float:
    """The swing with which all that grows with it stays within a share of its limit, by the first look."""
    limits, ticks = rig.limits, looked.ticks
    port_nm, velocity_rad_s = ticks["torque_nm"], ticks["velocity_rad_s"]
    used = (
        (ticks["load_torque_nm"], limits.load_torque_nm),
        (port_nm, limits.torque_nm),
        (velocity_rad_s, limits.velocity_rad_s),
        (ticks["position_rad"] - ticks["position_rad"][0], limits.position_rad),
    )
    shares = [float(np.nanmax(np.abs(values))) / limit for values, limit in used]
    shares.append(sqrt(float(np.nanmax(np.abs(port_nm * velocity_rad_s))) / limits.power_w))
    return LOOK_SHARE * section.swing_rad * SHARE / max(shares)


def reaches(arm: Arm, reach: Reach) -> JointPlan:
    """The same movement, to and fro, with zero torque at both ports."""
    rest, there = hold(0.0, SETTLE_S, arm.tick_s), hold(1.0, reach.hold_s, arm.tick_s)
    out = np.concatenate([rest, there])
    for trial in range(1, reach.trials + 1):
        for name, shares in ((OUT, out), (BACK, 1.0 - out)):
            yield tuple(
                zero_torque(REACH, f"{name} {trial}", Use.IDENTIFY, command * shares, rig)
                for rig, command in zip(arm.rigs, reach.commands, strict=True)
            )


def duration_s(arm: Arm) -> float:
    """Of both [s of bench time]."""
    section, reach = arm.impedance, arm.reach
    moved_s = 2 * (section.periods + 3.0) * section.period_s + 4 * SETTLE_S + FREE_S
    return moved_s + (0.0 if reach is None else 2 * reach.trials * (reach.hold_s + SETTLE_S))
