"""The paper's motor fitted as one would with a general tool: CasADi, direct multiple shooting, IPOPT.

Command and port torque go in, the shaft's velocity is to come out: an output-error fit with the states free at the
beginning of every interval and continuity as a constraint (Bock 1984; Gauss-Newton Hessian, as in CasADi's example
``sysid_gauss_newton``). What it is given and our own fit is not: a start within 30 %, the delays, and aligned signals.
The kink of |ω| is rounded off for IPOPT. Lag and friction are advanced by their exact flows: with Runge-Kutta the
friction's contact, 1e4 per second and faster, would ask for steps of 50 µs.
"""

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from norton_bench.arrays import FloatArray
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import FINE, Signals

INTERVAL_TICKS = 5
SUBSTEPS = 4
ROUNDED_RAD_S = (0.5, 0.02)  # |ω| becomes √(ω² + this²), one solution being the start of the next
MOST_ITERATIONS = 40
STABILISING = 1e-6  # on the Hessian's diagonal: changes the way to the minimum, not the minimum
# Two steps that hardly change the cost end it: the last digits are worth nothing here, and would cost most.
STOP = {
    "tol": 1e-6,
    "mu_init": 1e-4,
    "acceptable_iter": 2,
    "acceptable_obj_change_tol": 1e-5,
    "acceptable_constr_viol_tol": 1e-3,
    "acceptable_compl_inf_tol": 1e-2,
    "acceptable_dual_inf_tol": 1e10,
    "acceptable_tol": 1e3,
}
HOLD = 0.1  # weight of the friction's first state
WITHIN = 4.0  # every parameter is sought within this factor of its start
FINEST = 8  # of a substep, to find when a command changed within it


@dataclass(frozen=True)
class Record:
    """Aligned signals: velocity at every tick, (n,); command and torque as means of the SUBSTEPS that follow each."""

    tick_s: float
    command: FloatArray
    torque_nm: FloatArray
    velocity_rad_s: FloatArray

    @property
    def intervals(self) -> int:
        return (len(self.velocity_rad_s) - 1) // INTERVAL_TICKS

    def per_interval(self, signal: FloatArray, length: int) -> FloatArray:
        """Shape (length, intervals), from the first on."""
        count = self.intervals * length
        return signal[:count].reshape(self.intervals, length).T


def aligned(signals: Signals, found: FitResult) -> Record:
    """One stretch, shifted by the delays that another fit found, band-limited between the ticks."""
    assert signals.torque_nm is not None
    count, step_s = len(signals.time_s) * SUBSTEPS, signals.tick_s / SUBSTEPS
    finest_s = signals.time_s[0] + (np.arange(count * FINEST) + 0.5) * step_s / FINEST
    held = np.searchsorted(signals.sent_s + found.command_delay_s, finest_s, "right") - 1
    command = signals.command[np.maximum(held, 0)].reshape(count, FINEST).mean(axis=1)
    middles_s = signals.time_s[0] + (np.arange(count) + 0.5) * step_s
    fine_s = signals.time_s[0] + np.arange(signals.position_rad.size) * (signals.tick_s / FINE)
    velocity = np.gradient(signals.position_rad, signals.tick_s / FINE)
    return Record(
        signals.tick_s,
        command,
        CubicSpline(signals.time_s, signals.torque_nm)(middles_s),
        np.interp(signals.time_s + found.motion_delay_s, fine_s, velocity),
    )


@dataclass(frozen=True)
class Fitted:
    """Parameters by name, and what it took."""

    values: dict[str, float]
    build_s: float
    solve_s: float
    iterations: int
    converged: bool


def fit_by_shooting(record: Record, start: dict[str, float]) -> Fitted:
    """Fit all seven parameters and the torque sensor's zero, from ``start``."""
    begun_s = time.process_time()
    scale = np.array([start[name] for name in PHYSICAL] + [0.1 * start["coulomb_torque"]])
    parameters = ca.MX.sym("parameters", len(scale))
    first = _start(record, start)
    first_sliding = float(first[len(scale) + 2])
    nodes = ca.MX.sym("nodes", 3, record.intervals + 1)
    rounded = ca.MX.sym("rounded")
    interval = _interval(record.tick_s, scale)
    ends, velocity = interval.map(record.intervals)(
        nodes[:, :-1],
        ca.repmat(parameters, 1, record.intervals),
        record.per_interval(record.command, INTERVAL_TICKS * SUBSTEPS),
        record.per_interval(record.torque_nm, INTERVAL_TICKS * SUBSTEPS),
        ca.repmat(rounded, 1, record.intervals),
    )
    unknowns = ca.veccat(parameters, nodes)
    measured = record.per_interval(record.velocity_rad_s[1:], INTERVAL_TICKS)
    residual = ca.vec(velocity - measured) / np.std(measured)
    # Where the friction's contact stands at the very beginning is soon forgotten: something must hold it.
    residual = ca.vertcat(residual, HOLD * (nodes[2, 0] - first_sliding))
    slopes = ca.jacobian(residual, unknowns)
    multiplier = ca.MX.sym("multiplier")
    hessian = ca.triu(multiplier * (ca.mtimes(slopes.T, slopes) + STABILISING * ca.MX.eye(unknowns.numel())))
    gaps = ca.vec(ends - nodes[:, 1:])
    solver = ca.nlpsol(
        "fit",
        "ipopt",
        {"x": unknowns, "f": 0.5 * ca.dot(residual, residual), "g": gaps, "p": rounded},
        {
            "hess_lag": ca.Function("hessian", [unknowns, rounded, multiplier, ca.MX.sym("m", gaps.numel())],
                                    [hessian]),
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": MOST_ITERATIONS, **STOP},
            "print_time": False,
        },
    )  # fmt: skip
    solve_from_s = time.process_time()
    box = np.full(len(first), np.inf)
    box[: len(PHYSICAL)] = np.log(WITHIN)
    iterations = 0
    for each in ROUNDED_RAD_S:
        found = solver(x0=first, lbx=-box, ubx=box, lbg=0, ubg=0, p=each)
        first, stats = found["x"], solver.stats()
        iterations += int(stats["iter_count"])
    ended_s = time.process_time()
    values = np.array(found["x"]).ravel()[: len(scale)]
    physical = scale * np.concatenate([np.exp(values[:-1]), values[-1:]])
    return Fitted(
        dict(zip(PHYSICAL, physical.tolist(), strict=False)),
        solve_from_s - begun_s,
        ended_s - solve_from_s,
        iterations,
        bool(stats["success"]),
    )


def _interval(tick_s: float, scale: FloatArray) -> ca.Function:
    """From the states (driving torque over τc, ω, h) at a node to those at the next, and the velocity at every tick."""
    state, parameters = ca.SX.sym("state", 3), ca.SX.sym("parameters", len(scale))
    command, torque = (ca.SX.sym(name, INTERVAL_TICKS * SUBSTEPS) for name in ("command", "torque"))
    *physical, bias = (
        scale[k] * (parameters[k] if k == len(PHYSICAL) else ca.exp(parameters[k])) for k in range(len(scale))
    )
    gain, bandwidth, inertia, damping, coulomb, stiffness, contact_damping = physical
    rounded = ca.SX.sym("rounded")
    step_s = tick_s / SUBSTEPS
    kept = ca.exp(-bandwidth * step_s)
    drive, omega, sliding = ca.vertsplit(state)
    velocities = []
    for substep in range(INTERVAL_TICKS * SUBSTEPS):
        settled = gain * command[substep]
        middle = settled + (drive - settled) * ca.sqrt(kept)
        drive = settled + (drive - settled) * kept
        side, left = _side(omega, rounded, stiffness / coulomb * step_s / 2)
        sliding = side + (sliding - side) * left
        pushed = step_s / inertia * (middle - torque[substep] + bias - coulomb * sliding)
        # Taken at the end of the step: explicitly, presliding damping would need finer ones.
        resisting = step_s / inertia * (damping + contact_damping * (1 - sliding * side))
        omega = (omega + pushed) / (1 + resisting)
        side, left = _side(omega, rounded, stiffness / coulomb * step_s / 2)
        sliding = side + (sliding - side) * left
        if substep % SUBSTEPS == SUBSTEPS - 1:
            velocities.append(omega)
    return ca.Function(
        "interval",
        [state, parameters, command, torque, rounded],
        [ca.vertcat(drive, omega, sliding), ca.vertcat(*velocities)],
    )


def _side(omega: ca.SX, rounded: ca.SX, per_speed: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The sign of the velocity, rounded off, and what is left of the friction's state after so much travel."""
    speed = ca.sqrt(omega**2 + rounded**2)
    return omega / speed, ca.exp(-per_speed * speed)


def _start(record: Record, start: dict[str, float]) -> FloatArray:
    """Parameters at their scale; nodes from the measured velocity, lag and friction run along it."""
    drive, sliding = np.zeros(len(record.velocity_rad_s)), np.zeros(len(record.velocity_rad_s))
    kept = np.exp(-start["amplifier_bandwidth"] * record.tick_s)
    per_rad = start["presliding_stiffness"] / start["coulomb_torque"]
    for k in range(1, len(drive)):
        settled = start["torque_gain"] * record.command[SUBSTEPS * k - 1]
        drive[k] = settled + (drive[k - 1] - settled) * kept
        velocity = record.velocity_rad_s[k]
        side = np.sign(velocity)
        sliding[k] = side + (sliding[k - 1] - side) * np.exp(-per_rad * abs(velocity) * record.tick_s)
    at = np.arange(record.intervals + 1) * INTERVAL_TICKS
    nodes = np.stack([drive[at], record.velocity_rad_s[at], sliding[at]])
    return np.concatenate([np.zeros(len(PHYSICAL) + 1), nodes.T.ravel()])
