"""A bench of its own for the identifier's tests: explicit fine steps, and every imperfection of transport.

Nothing here is shared with the identifier or with the bench's simulator: symplectic Euler at 10 µs, the friction
contact by its exponential, devices sampling at phases of their own, delays and jitter on the way to the host.
"""

from dataclasses import dataclass, field, fields, replace
from itertools import pairwise

import numpy as np
from numba import njit

from norton_bench.records import CURRENT, MOTION, NO_DEVICE_TIME, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.segments import Use

TICK_S = 1e-3
STEPS = 100  # of 10 µs in a tick
FREE, IMPOSED, PUSHED = 0, 1, 2


@dataclass(frozen=True)
class Truth:
    torque_gain: float = 0.9
    amplifier_bandwidth: float = 600.0
    inertia: float = 5e-5
    viscous_damping: float = 1e-3
    coulomb_torque: float = 0.02
    presliding_stiffness: float = 10.0
    presliding_damping: float = 0.01
    torque_constant: float = 0.05

    @property
    def amplifier_gain(self):
        return self.torque_gain / self.torque_constant

    def array(self):
        return np.array(
            [
                self.torque_gain,
                self.amplifier_bandwidth,
                self.inertia,
                self.viscous_damping,
                self.coulomb_torque,
                self.presliding_stiffness,
                self.presliding_damping,
            ]
        )


NAMES = (
    "torque_gain",
    "amplifier_bandwidth",
    "inertia",
    "viscous_damping",
    "coulomb_torque",
    "presliding_stiffness",
    "presliding_damping",
)
LOAD = Truth(0.95, 1000.0, 1.2e-4, 3e-4, 8e-3, 8.0, 5e-3)


@dataclass(frozen=True)
class Departs:
    """What the actuator does that the paper's motor does not, each as a textbook writes it."""

    stribeck_drop: float = 0.0  # of the Coulomb torque, from rest to fast sliding
    stribeck_velocity: float = 5.0
    asymmetry: float = 0.0
    load_friction: float = 0.0
    saturation: float = 0.0  # per square of the command
    drag: float = 0.0
    ripple: float = 0.0  # of the torque, 14 periods a turn
    friction_by_position: float = 0.0  # 3 periods a turn
    damping_drift: float = 0.0  # a second
    gain_drift: float = 0.0
    friction_drift: float = 0.0
    joint_stiffness: float = 0.0  # of a spring between motor and port; 0: the motor is at the port
    joint_damping: float = 0.0
    output_inertia: float = 0.0

    def array(self):
        return np.array([float(getattr(self, each.name)) for each in fields(self)])


@dataclass(frozen=True)
class Bench:
    """The imperfect rest of the bench."""

    load: Truth = LOAD
    stiffness: float = 200.0
    damping: float = 0.01
    noise_nm: float = 1e-3
    bias_nm: float = 3e-3
    drift_nm_s: float = 2e-6
    cogging_nm: float = 0.3e-3
    counts: float = 131072.0
    can_delay_s: float = 250e-6
    can_jitter_s: float = 50e-6
    serial_delay_s: float = 1160e-6
    serial_jitter_s: float = 100e-6
    device_clock: bool = True
    current_noise_a: float = 5e-3
    least_command: float = 0.0  # below it the drive switches its bridge off, and the current ends
    departs: Departs = Departs()


@njit(cache=True, error_model="numpy")
def departed(a, departs, ia, wa, ta, port, time):
    """Friction's bound, the motor's torque and the viscous damping, there and then."""
    # What is nought takes no time: exponentials and cosines are most of it.
    fade = departs[0] * (1 - np.exp(-((wa / departs[1]) ** 2))) if departs[0] != 0.0 else 0.0
    place = departs[7] * np.cos(3 * ta) if departs[7] != 0.0 else 0.0
    ripple = departs[6] * np.cos(14 * ta) if departs[6] != 0.0 else 0.0
    bound = a[4] * (1 - fade) * (1 + departs[2] * np.sign(wa)) * (1 + departs[10] * time)
    bound = bound * (1 + place) + departs[3] * abs(port)
    motor = ia * (1 + ripple) * (1 + departs[9] * time)
    motor /= 1 + departs[4] * (ia / a[0]) ** 2
    return bound, motor, a[3] * (1 + departs[8] * time) + departs[5] * abs(wa)


@njit(cache=True, error_model="numpy")
def motor_of(departs, tq, wq, ta, wa, port):
    """What the motor carries, its own angle and velocity: those of the port where no spring is between."""
    if departs[11] > 0.0:
        return departs[11] * (tq - ta) + departs[12] * (wq - wa), tq, wq
    return port, ta, wa


@njit(cache=True, error_model="numpy")
def simulate(a, b, k, d, cogging, departs, released, mode, command, load_command, v_ref, x_ref, ff, phases, jitter):
    """One tick at a time; returns samples at the devices' phases and the true port torque."""
    ticks = command.size
    dt = 1e-3 / 100
    out = np.empty((ticks, 5))  # actuator position, load position, torque, current torque, actuator velocity
    ta = wa = fa = ia = tl = wl = fl = il = tq = wq = 0.0
    ca = cl = integral = x0 = 0.0
    sent_l = np.zeros(ticks)
    delay = 25
    lag_a, lag_b = 1 - np.exp(-a[1] * dt), 1 - np.exp(-b[1] * dt)
    for n in range(ticks):
        if mode[n] == 2:
            want = load_command[n]
        elif mode[n] == 1:
            if n == 0 or mode[n - 1] != 1:
                x0 = tl - x_ref[n]
            integral = 0.0
            want = (ff[n] + 0.04 * (v_ref[n] - wl) + 4.0 * (x_ref[n] + x0 - tl)) / b[0]
        else:
            # Zero torque: the load's own dynamics fed forward from the actuator's acceleration, plus feedback.
            port = k * (ta - tl) + d * (wa - wl)
            integral += port * 1e-3
            want = (0.5 * port + 30.0 * integral + 0.8 * (b[3] * wl + fl)) / b[0]
        want = min(max(want, -1.0), 1.0)
        sent_l[n] = want
        for j in range(100):
            if j == delay + jitter[n, 0]:
                ca = command[n]
            if j == delay + jitter[n, 1]:
                cl = want
            port = k * (ta - tl) + d * (wa - wl)
            ia = 0.0 if released and ca == 0.0 else ia + (a[0] * ca - ia) * lag_a
            il += (b[0] * cl - il) * lag_b
            carried, tq, wq = motor_of(departs, tq, wq, ta, wa, port)
            bound, motor, viscous = departed(a, departs, ia, wq, tq, carried, (n + j / 100) * 1e-3)
            sa, sl = a[5] / bound, b[5] / b[4]
            # friction at the present velocity, σ1 taken implicitly
            ra, rl = a[6] * (1 - (fa / bound) * np.sign(wq)), b[6] * (1 - (fl / b[4]) * np.sign(wl))
            push = motor - carried - fa - (cogging * np.sin(42 * tq) if cogging != 0.0 else 0.0)
            wq = (wq + dt * push / a[2]) / (1 + dt * (viscous + ra) / a[2])
            wa = wa + dt * (carried - port) / departs[13] if departs[11] > 0.0 else wq
            wl = (wl + dt * (il + port - fl) / b[2]) / (1 + dt * (b[3] + rl) / b[2])
            da, dl = wq * dt, wl * dt
            tq, ta, tl = tq + da, ta + wa * dt, tl + dl
            ea, el = np.exp(-sa * abs(da)), np.exp(-sl * abs(dl))
            fa, fl = np.sign(da) * bound * (1 - ea) + fa * ea, np.sign(dl) * b[4] * (1 - el) + fl * el
            if j == phases[0]:
                out[n, 0] = ta
                out[n, 4] = wa
            if j == phases[1]:
                out[n, 1] = tl
            if j == phases[2]:
                out[n, 2] = k * (ta - tl) + d * (wa - wl)
            if j == phases[3]:
                out[n, 3] = ia
    return out, sent_l


@dataclass
class Plan:
    """Segments one after the other."""

    seed: int = 0
    parts: list = field(default_factory=list)

    def add(self, procedure, name, use, command, mode=FREE, load_command=None, velocity=None):
        zeros = np.zeros(len(command))
        velocity = zeros if velocity is None else velocity
        load_command = zeros if load_command is None else load_command
        self.parts.append((procedure, name, use, np.asarray(command, float), mode, load_command, velocity))
        return self


def multisine(rng, duration_s, low, high, slope=0.0, lines=60):
    t = np.arange(round(duration_s / TICK_S)) * TICK_S
    f = np.geomspace(low, high, lines) * (1 + 0.02 * rng.uniform(-1, 1, lines))
    wave = (f / low) ** slope @ np.sin(2 * np.pi * np.outer(f, t) + rng.uniform(0, 2 * np.pi, lines)[:, None])
    wave *= np.clip(np.minimum(t, t[-1] - t) / 0.25, 0, 1)
    return wave / np.abs(wave).max()


def smooth(values, change_s, dwell_s, start=0.0):
    out, before = [], start
    n = round(change_s / TICK_S)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, n + 1) / n)
    for value in values:
        out += [before + (value - before) * ramp, np.full(round(dwell_s / TICK_S), value)]
        before = value
    return np.concatenate(out)


def free_parts(plan, truth, rng, multisine_s=12.0, speed=36.0):
    top = (truth.coulomb_torque + truth.viscous_damping * speed) / truth.torque_gain
    levels = np.linspace(-top, top, 11)
    for name, stairs in (("staircase rising", levels), ("staircase falling", levels[::-1])):
        plan.add("free", "approach", Use.PREPARE, smooth([stairs[0]], 0.4, 0.0))
        plan.add("free", name, Use.IDENTIFY, np.repeat(stairs, 400))
        plan.add("free", "leave", Use.PREPARE, smooth([0.0], 0.4, 0.1, stairs[-1]))
    plan.add("free", "multisine", Use.IDENTIFY, 0.95 * top * multisine(rng, multisine_s, 0.2, 200, -0.25))
    return plan.add("free", "rest", Use.PREPARE, np.zeros(400))


def blocked_parts(plan, truth, speed=36.0):
    top = (truth.coulomb_torque + truth.viscous_damping * speed) / truth.torque_gain
    for level in np.linspace(-top, top, 5):
        for side, sign in (("above", 1.0), ("below", -1.0)):
            velocity = np.concatenate([smooth([sign * 2.4], 0.1, 0.3), smooth([0.0], 0.1, 0.1, sign * 2.4)])
            plan.add(
                "blocked", f"approach from {side}", Use.IDENTIFY, np.full(len(velocity), level), IMPOSED, None, velocity
            )
            plan.add("blocked", f"hold from {side}", Use.IDENTIFY, np.full(500, level), IMPOSED)
    return plan


def imposed_parts(plan, truth, rng, multisine_s=20.0, speed=36.0):
    top = (truth.coulomb_torque + truth.viscous_damping * speed) / truth.torque_gain
    grid = smooth(np.array([0.1, -0.1, 0.4, -0.4, 1.0, -1.0, 0.0]) * 0.8 * speed, 0.15, 0.35)
    for level in (-top, 0.0, top):
        command = np.full(len(grid), level)
        command[:150] = smooth([level], 0.15, 0)
        command[-150:] = command[:150][::-1]
        plan.add("imposed", f"grid {level:.3g}", Use.IDENTIFY, command, IMPOSED, None, grid)
    for amplitude in (0.5e-3, 1.5e-3, 5e-3, 15e-3, 50e-3):
        t = np.arange(1000) * TICK_S
        w = 2 * np.pi * 4
        velocity = amplitude * w * np.cos(w * t) * np.clip(np.minimum(t, 1 - t) / 0.25, 0, 1)
        plan.add("imposed", f"loop {amplitude}", Use.IDENTIFY, np.zeros(1000), IMPOSED, None, velocity)
    motion = 0.6 * speed * multisine(rng, multisine_s, 0.3, 60, -0.6, 40)
    command = 0.95 * top * multisine(rng, multisine_s, 0.2, 200, -0.25)
    plan.add("imposed", "multisine", Use.IDENTIFY, command, IMPOSED, None, motion)
    return plan.add("imposed", "rest", Use.PREPARE, np.zeros(300), IMPOSED)


def looked_at(came_ns, rng, pauses=6, busy=0.003, tick_ns=1_000_000):
    """When a loop sees what came on a line that bears no stamps, shape of ``came_ns``: at its next tick.

    Each pause leaves the ticks in another phase. A busy computer wakes the loop late now and then, and once leaves
    it standing for 18 ms.
    """
    edges = np.sort(rng.integers(came_ns[0], came_ns[-1], pauses))
    edges = np.concatenate([[came_ns[0]], edges, [came_ns[-1] + 3 * tick_ns]])
    looks = [np.arange(a + rng.integers(tick_ns), b, tick_ns) for a, b in pairwise(edges)]
    looks = np.concatenate([*looks, edges[-1:]])
    looks += np.where(rng.random(looks.size) < busy, rng.integers(0, tick_ns, looks.size), 0)
    stands_ns = rng.integers(came_ns[0], came_ns[-1])
    looks = np.sort(looks[(looks < stands_ns) | (looks > stands_ns + 18_000_000)])
    return looks[np.searchsorted(looks, came_ns)]


def calibration(seed=0, truth=None, bench=None, duration_s=8.0, share=0.5):
    """The load shaken, and the actuator on its own account by ``share`` of the torque (0: it idles)."""
    truth, bench = truth or Truth(), bench or Bench()
    rng = np.random.default_rng([seed, 5])
    top = 6 * (bench.load.coulomb_torque + truth.coulomb_torque)
    wave = top * multisine(rng, duration_s, 0.5, 200, -0.25)
    plan = Plan().add("calibrate", "rest", Use.PREPARE, np.zeros(300), PUSHED)
    own = share * top / truth.torque_gain * multisine(rng, duration_s, 0.5, 200, -0.25)
    plan.add("calibrate", "shake", Use.CALIBRATE, own, PUSHED, wave)
    return run(plan.add("calibrate", "rest", Use.PREPARE, np.zeros(300), PUSHED), truth, bench, seed)


def experiment(seed=0, truth=None, bench=None, *, free=True, blocked=True, imposed=True, multisine_s=20.0):
    truth, bench = truth or Truth(), bench or Bench()
    rng = np.random.default_rng([seed, 6])
    plan = Plan().add("tare", "rest", Use.TARE, np.zeros(300), PUSHED)
    if free:
        free_parts(plan, truth, rng)
    if blocked:
        blocked_parts(plan, truth)
    if imposed:
        imposed_parts(plan, truth, rng, multisine_s)
    return run(plan, truth, bench, seed)


def brief(seed=0, truth=None, bench=None, *, multisine_s=14.0):
    """Multisines of command and imposed motion alone: they tell everything, in a quarter of an experiment's time."""
    truth, bench = truth or Truth(), bench or Bench()
    plan = Plan().add("tare", "rest", Use.TARE, np.zeros(300), PUSHED)
    *_, wave, rest = imposed_parts(Plan(), truth, np.random.default_rng([seed, 6]), multisine_s).parts
    return run(replace(plan, parts=[*plan.parts, wave, rest]), truth, bench, seed)


def varied(seed=0, bench=None):
    """Multisines free and imposed, and constant speeds: what tells departures apart, in 24 s. Staircases and loops,
    which take as long, tell less of them."""
    rng = np.random.default_rng([seed, 6])
    plan = Plan().add("tare", "rest", Use.TARE, np.zeros(300), PUSHED)
    whole = imposed_parts(free_parts(Plan(), Truth(), rng, 8.0), Truth(), rng, 4.0)
    kept = [part for part in whole.parts if part[1].split()[0] in ("multisine", "grid", "rest")]
    return run(replace(plan, parts=[*plan.parts, *kept]), Truth(), bench or Bench(), seed)


def validation(seed=0, truth=None, bench=None):
    truth, bench = truth or Truth(), bench or Bench()
    rng = np.random.default_rng([seed, 7])
    plan = Plan().add("validate", "rest", Use.PREPARE, np.zeros(300), FREE)
    free_parts(plan, truth, rng, 6.0)
    imposed_parts(plan, truth, rng, 6.0)
    parts = [
        (p, n, Use.VALIDATE if u is Use.IDENTIFY and n == "multisine" else Use.PREPARE, *r)
        for p, n, u, *r in plan.parts
    ]
    return run(replace(plan, parts=parts), truth, bench, seed)


def run(plan, truth, bench, seed, origin_ns=5_000_000_000):
    rng = np.random.default_rng([seed, 8])
    command, load_command, velocity = (np.concatenate([p[i] for p in plan.parts]) for i in (3, 5, 6))
    mode = np.concatenate([np.full(len(p[3]), p[4]) for p in plan.parts])
    command = np.where(np.abs(command) < bench.least_command, 0.0, command)
    n = len(command)
    position = np.cumsum(velocity) * TICK_S
    ff = np.gradient(velocity, TICK_S) * (bench.load.inertia + truth.inertia) * (mode == IMPOSED)
    ff = np.clip(ff, -0.5, 0.5) + 0.5 * bench.load.coulomb_torque * np.tanh(velocity)
    phases = rng.integers(0, 100, 4)
    steps = round(bench.can_jitter_s / 1e-5)
    jitter = rng.integers(-steps, steps + 1, (n, 2))
    out, sent_l = simulate(
        truth.array(), bench.load.array(), bench.stiffness, bench.damping, bench.cogging_nm, bench.departs.array(),
        bench.least_command > 0.0, mode, command, load_command, velocity, position, ff, phases, jitter,
    )  # fmt: skip
    tick_ns = origin_ns + np.arange(n) * 1_000_000
    taken_ns = [tick_ns + (p + 1) * 10_000 for p in phases]

    def travel(delay_s, jitter_s, stamps):
        late = stamps + np.round((delay_s + jitter_s * rng.uniform(-1, 1, n)) * 1e9).astype(int)
        return np.maximum.accumulate(late)

    def motion(angle, stamps):
        table = np.empty(n, MOTION)
        turns = np.floor(angle / (2 * np.pi) * bench.counts) / bench.counts
        table["position_rad"] = turns.astype(np.float32).astype(float) * 2 * np.pi
        table["velocity_rad_s"] = np.gradient(angle, TICK_S)
        table["sequence"] = np.arange(n)
        table["arrival_ns"] = travel(bench.can_delay_s, bench.can_jitter_s, stamps)
        table["device_ns"] = NO_DEVICE_TIME
        return table

    torque = np.empty(n, TORQUE)
    time_s = np.arange(n) * TICK_S
    torque["torque_nm"] = (
        out[:, 2] + bench.bias_nm + bench.drift_nm_s * time_s + bench.noise_nm * rng.standard_normal(n)
    ).astype(np.float32)
    torque["valid"] = True
    torque["sequence"] = np.arange(n)
    torque["arrival_ns"] = travel(bench.serial_delay_s, bench.serial_jitter_s, taken_ns[2])
    own = ((taken_ns[2] - taken_ns[2][0]) // 1000 * 1000 * (1 + 20e-6)).astype(int) + 123456789
    torque["device_ns"] = own if bench.device_clock else NO_DEVICE_TIME
    current = np.empty(n, CURRENT)
    current["current_a"] = out[:, 3] / truth.torque_constant + bench.current_noise_a * rng.standard_normal(n)
    current["sequence"] = np.arange(n)
    current["arrival_ns"] = travel(bench.can_delay_s, bench.can_jitter_s, taken_ns[3])
    current["device_ns"] = NO_DEVICE_TIME

    ticks = np.zeros(n, TICK)
    ticks["tick_ns"], ticks["command"], ticks["load_torque_nm"] = tick_ns, command, sent_l
    infos, first = [], 0
    for index, part in enumerate(plan.parts):
        last = first + len(part[3])
        ticks["segment"][first:last] = index
        mode_name = {FREE: "admittance", IMPOSED: "admittance", PUSHED: "torque"}[part[4]]
        start, end = int(tick_ns[first]), int(tick_ns[last - 1]) + 1_000_000
        infos.append(SegmentInfo(index, part[0], part[1], part[2], mode_name, start, end))
        first = last
    actuator, load = motion(out[:, 0], taken_ns[0]), motion(out[:, 1], taken_ns[1])
    return Measured(ticks, actuator, load, torque, current, tuple(infos))
