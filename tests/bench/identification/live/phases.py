"""Experiments for the live identifier: what excites everything, then what excites little; machines that change."""

from dataclasses import replace

import numpy as np

from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import FREE, IMPOSED, TICK_S, Departs, Plan, Truth, multisine, smooth

TOP = 0.06
NOTHING_DEPARTS = Departs()
PART_NS = 100_000_000


def feed(identifier, measured, part_s=1e-9 * PART_NS):
    """The estimate after each part. A part causes one fit at most: longer ones are for tests of later estimates."""
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    part_ns = round(part_s * 1e9)
    return [identifier.update(measured.between(at, at + part_ns)) for at in range(start, end, part_ns)]


def exciting(plan, rng, duration_s):
    """Multisines of command and motion, which tell everything."""
    motion = 22.0 * multisine(rng, duration_s, 0.3, 60, -0.6, 40)
    command = TOP * multisine(rng, duration_s, 0.2, 200, -0.25)
    return plan.add("imposed", "multisine", Use.IDENTIFY, command, IMPOSED, None, motion)


def dull(plan, kind, duration_s):
    """Data that tell little: the shaft held, or one speed, under a constant command; or a shaft left alone."""
    n = round(duration_s / TICK_S)
    change = smooth([20.0], 0.5, 0.0) if kind == "one speed" else np.zeros(0)
    velocity = np.concatenate([change, np.full(n - change.size, change[-1] if change.size else 0.0)])
    level = 0.5 * TOP if kind in ("one speed", "held") else 0.0
    command = np.full(n, level)
    if kind == "held, command shaken":
        command = TOP * multisine(np.random.default_rng(9), duration_s, 0.2, 200, -0.25)
    mode = FREE if kind == "left alone" else IMPOSED
    return plan.add("imposed", kind, Use.IDENTIFY, command, mode, None, velocity)


def exciting_then(kind, excited_s=16.0, dull_s=40.0, seed=1):
    rng = np.random.default_rng([seed, 21])
    plan = exciting(Plan().add("tare", "rest", Use.TARE, np.zeros(300), IMPOSED), rng, excited_s)
    return synthetic.run(dull(plan, kind, dull_s), Truth(), synthetic.Bench(), seed)


def exciting_for(duration_s, seed=1, departs=NOTHING_DEPARTS):
    rng = np.random.default_rng([seed, 22])
    plan = Plan().add("tare", "rest", Use.TARE, np.zeros(300), IMPOSED)
    for _ in range(max(round(duration_s / 20.0), 1)):
        exciting(plan, rng, min(duration_s, 20.0))
    return synthetic.run(plan, Truth(), synthetic.Bench(departs=departs), seed)


def drifting(measured, damping_share=0.0, coulomb_share=0.0, from_s=20.0):
    """As if viscous damping and Coulomb torque (presliding stiffness with it) grew, linearly, to so much more.

    Torque under a given motion is affine in both, so the same motion with another torque is what the changed machine
    would have shown.
    """
    truth, bench = Truth(), synthetic.Bench()
    late_s = float(np.median(measured.torque["arrival_ns"] - measured.motion["arrival_ns"])) * 1e-9
    late_s -= bench.serial_delay_s - bench.can_delay_s
    time_s = np.arange(len(measured.motion)) * TICK_S
    position, velocity = (
        np.interp(time_s + late_s, time_s, measured.motion[column]) for column in ("position_rad", "velocity_rad_s")
    )
    h = np.zeros(position.size)
    per_rad = truth.presliding_stiffness / truth.coulomb_torque
    for k, step in enumerate(np.diff(position), start=1):
        side = np.sign(step)
        h[k] = side + (h[k - 1] - side) * np.exp(-per_rad * abs(step))
    share = np.clip((time_s - from_s) / (time_s[-1] - from_s), 0.0, 1.0)
    extra = damping_share * truth.viscous_damping * velocity
    extra += coulomb_share * truth.coulomb_torque * h
    torque = measured.torque.copy()
    torque["torque_nm"] -= share * extra
    return replace(measured, torque=torque)
