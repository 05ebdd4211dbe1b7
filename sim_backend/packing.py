"""A bench's true values as the arrays that the integrator works on, and the substep they need."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend import integrator as columns
from sim_backend.truth import ActuatorTruth, LoadTruth, Truth

# The longest substep; stiffer benches take shorter ones, so that the fastest rate turns less than this in each.
LONGEST_SUBSTEP_S = 20e-6
LARGEST_TURN_RAD = 0.1


@dataclass(frozen=True)
class PackedBench:
    """``machines`` has shape (2, MACHINE_COLUMNS); the joining spring is in N m/rad and N m s/rad."""

    machines: NDArray[np.float64]
    stiffness: float
    damping: float
    substep_s: float


def pack(truth: Truth, shaft: str) -> PackedBench:
    """The bench with its load; without one, with the shaft "free" or "clamped" behind the torque sensor.

    Raises ValueError for another ``shaft``.
    """
    if shaft not in ("free", "clamped"):
        raise ValueError(f'shaft = {shaft!r} should be "free" or "clamped"')
    joined = truth.load is not None or shaft == "clamped"
    machines = np.array([_row(truth.actuator), _ground() if truth.load is None else _row(truth.load)])
    stiffness = truth.torque_sensor.stiffness_nm_rad if joined else 0.0
    damping = truth.torque_sensor.damping_nm_s_rad if joined else 0.0
    longest_s = LARGEST_TURN_RAD / _fastest_rate_rad_s(machines, stiffness, damping)
    return PackedBench(machines, stiffness, damping, min(LONGEST_SUBSTEP_S, longest_s))


def _row(machine: ActuatorTruth | LoadTruth) -> NDArray[np.float64]:
    row = np.zeros(columns.MACHINE_COLUMNS)
    motor = machine.motor
    row[columns.INVERSE_INERTIA] = 1.0 / motor.Im
    row[columns.VISCOUS] = motor.B
    row[columns.COULOMB] = motor.tau_c
    row[columns.STIFFNESS] = motor.sigma_0
    row[columns.DAMPING] = motor.sigma_1
    row[columns.TORQUE_CONSTANT] = machine.mounted * motor.Km
    if machine.cogging is not None:
        row[columns.COGGING_AMPLITUDE] = machine.cogging.amplitude_nm
        row[columns.COGGING_PERIODS] = machine.cogging.periods_per_turn
    row[columns.COUNTS_PER_RAD] = machine.mounted * machine.counts_per_turn / math.tau
    row[columns.TRACKER_BANDWIDTH] = machine.encoder_bandwidth_rad_s
    return row


def _ground() -> NDArray[np.float64]:
    """A machine that stands still, whatever pulls at it."""
    row = np.zeros(columns.MACHINE_COLUMNS)
    row[columns.COULOMB] = 1.0
    return row


def _fastest_rate_rad_s(machines: NDArray[np.float64], stiffness: float, damping: float) -> float:
    """The greatest natural or damping rate the bench can show; friction that reverses is twice as stiff."""
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    cogging = machines[:, columns.COGGING_AMPLITUDE] * machines[:, columns.COGGING_PERIODS]
    own_stiffness = np.diag(2.0 * machines[:, columns.STIFFNESS] + cogging)
    own_damping = np.diag(2.0 * machines[:, columns.DAMPING] + machines[:, columns.VISCOUS])
    roots = np.sqrt(machines[:, columns.INVERSE_INERTIA])
    weights = np.outer(roots, roots)
    natural = math.sqrt(np.linalg.eigvalsh(weights * (stiffness * pair + own_stiffness))[-1])
    damped = np.linalg.eigvalsh(weights * (damping * pair + own_damping))[-1]
    return max(natural, float(damped))
