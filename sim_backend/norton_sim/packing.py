"""A bench's true values as the arrays that the integrator works on, and the substep they need."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from norton_sim import integrator as columns
from norton_sim.plants import assembled as link_columns
from norton_sim.plants.assembled import Assembled, Link
from norton_sim.tables import Body, Drive, Gravity
from norton_sim.truth import LoadTruth, ModulatorTruth, MotorTruth, Truth

# The longest substep; stiffer benches take shorter ones, so that the fastest rate turns less than this in each.
LONGEST_SUBSTEP_S = 20e-6
LARGEST_TURN_RAD = 0.1
# A spring that hardens is taken to be deflected no further than this.
HARDENED_RAD = 0.5


@dataclass(frozen=True)
class PackedBench:
    """``machines`` has shape (2, MACHINE_COLUMNS); the joining spring is in N m/rad and N m s/rad.

    With a ``link`` (LINK_COLUMNS,) behind the actuator's body there is a third machine, its source, and where that
    has a modulator, a fourth: the modulator's motor. ``departures`` (DEPARTURE_COLUMNS,) are the torque motor's.
    """

    machines: NDArray[np.float64]
    stiffness: float
    damping: float
    substep_s: float
    link: NDArray[np.float64] | None = None
    departures: NDArray[np.float64] | None = None


def pack(truth: Truth, shaft: str) -> PackedBench:
    """The bench with its load; without one, with the shaft "free" or "clamped" behind the torque sensor.

    Raises ValueError for another ``shaft``.
    """
    if shaft not in ("free", "clamped"):
        raise ValueError(f'shaft = {shaft!r} should be "free" or "clamped"')
    joined = truth.load is not None or shaft == "clamped"
    link = truth.actuator.link if isinstance(truth.actuator, Assembled) else None
    machines = np.array([_actuator(truth.actuator), _ground() if truth.load is None else _machine(truth.load)])
    if link is not None:
        machines = np.vstack([machines, _source(link)])
    stiffness = truth.torque_sensor.stiffness_nm_rad if joined else 0.0
    damping = truth.torque_sensor.damping_nm_s_rad if joined else 0.0
    row = None if link is None else _modulated(link.row, truth.modulator)
    longest_s = LARGEST_TURN_RAD / _fastest_rate_rad_s(machines, stiffness, damping, row)
    if truth.modulator is not None:
        machines = np.vstack([machines, _modulator(truth.modulator)])
    departures = truth.actuator.departures if isinstance(truth.actuator, MotorTruth) else None
    departs = None if departures is None else departures.row()
    return PackedBench(machines, stiffness, damping, min(LONGEST_SUBSTEP_S, longest_s), row, departs)


def _actuator(actuator: MotorTruth | Assembled) -> NDArray[np.float64]:
    if isinstance(actuator, MotorTruth):
        return _machine(actuator)
    row = _body(actuator.output)
    _encode(row, actuator)
    return row


def _machine(machine: MotorTruth | LoadTruth) -> NDArray[np.float64]:
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
        row[columns.COGGING_PHASE] = machine.cogging.phase_rad
    _hang(row, machine.gravity)
    _encode(row, machine)
    return row


def _body(body: Body) -> NDArray[np.float64]:
    row = _ground()
    row[columns.INVERSE_INERTIA] = 1.0 / body.inertia_kg_m2
    row[columns.VISCOUS] = body.viscous_damping_nm_s_rad
    if body.coulomb_torque_nm > 0:
        row[columns.COULOMB] = body.coulomb_torque_nm
        row[columns.STIFFNESS] = body.presliding_stiffness_nm_rad
        row[columns.DAMPING] = body.presliding_damping_nm_s_rad
    _hang(row, body.gravity)
    return row


def _source(link: Link) -> NDArray[np.float64]:
    if link.source is None:
        return _ground()
    row = _body(link.source)
    if link.row[link_columns.DRIVE] == link_columns.TORQUE:
        row[columns.TORQUE_CONSTANT] = link.source_torque_constant_nm_a
    return row


def _modulated(row: NDArray[np.float64], modulator: ModulatorTruth | None) -> NDArray[np.float64]:
    """A link's row with what its modulator does; nothing is modulated where there is none."""
    if modulator is None:
        row[link_columns.STIFFENING] = 0.0
    else:
        row[link_columns.MODULATOR_TRAVEL] = modulator.mounted * modulator.travel / modulator.amplifier_gain
        row[link_columns.MODULATOR_BANDWIDTH] = modulator.bandwidth_rad_s
    return row


def _modulator(modulator: ModulatorTruth) -> NDArray[np.float64]:
    row = _ground()
    _encode(row, modulator)
    return row


def _hang(row: NDArray[np.float64], gravity: Gravity | None) -> None:
    if gravity is not None:
        row[columns.GRAVITY_AMPLITUDE] = gravity.amplitude_nm
        row[columns.GRAVITY_ZERO] = gravity.zero_rad


def _encode(row: NDArray[np.float64], drive: Drive) -> None:
    row[columns.COUNTS_PER_RAD] = drive.mounted * drive.counts_per_turn / math.tau
    row[columns.TRACKER_BANDWIDTH] = drive.encoder_bandwidth_rad_s


def _ground() -> NDArray[np.float64]:
    """A machine that stands still, whatever pulls at it."""
    row = np.zeros(columns.MACHINE_COLUMNS)
    row[columns.COULOMB] = 1.0
    return row


def _fastest_rate_rad_s(
    machines: NDArray[np.float64], stiffness: float, damping: float, link: NDArray[np.float64] | None
) -> float:
    """The greatest natural or damping rate the bench can show; friction that reverses is twice as stiff."""
    cogging = machines[:, columns.COGGING_AMPLITUDE] * machines[:, columns.COGGING_PERIODS]
    gravity = machines[:, columns.GRAVITY_AMPLITUDE]
    springs = np.diag(2.0 * machines[:, columns.STIFFNESS] + cogging + gravity)
    springs += _joined(len(machines), 0, 1, stiffness)
    dampers = np.diag(2.0 * machines[:, columns.DAMPING] + machines[:, columns.VISCOUS])
    dampers += _joined(len(machines), 0, 1, damping)
    if link is not None:
        springs += _joined(3, 0, 2, _stiffest(link))
        dampers += _joined(3, 0, 2, link[link_columns.DAMPER])
        springs[2, 2] += link[link_columns.SERVO_STIFFNESS]
        dampers[2, 2] += link[link_columns.SERVO_DAMPING]
    roots = np.sqrt(machines[:, columns.INVERSE_INERTIA])
    weights = np.outer(roots, roots)
    natural = math.sqrt(np.linalg.eigvalsh(weights * springs)[-1])
    damped = np.linalg.eigvalsh(weights * dampers)[-1]
    return max(natural, float(damped))


def _stiffest(link: NDArray[np.float64]) -> float:
    """The greatest stiffness that a connection can have."""
    hardened = 3 * link[link_columns.HARDENING] * HARDENED_RAD**2
    modulated = link[link_columns.STIFFENING] * link[link_columns.MODULATOR_STOP]
    return float(link[link_columns.SPRING] + link[link_columns.MOVING_SPRING] + modulated + hardened)


def _joined(bodies: int, first: int, second: int, value: float) -> NDArray[np.float64]:
    """What a spring or damper between two of the bodies adds, shape (bodies, bodies)."""
    matrix = np.zeros((bodies, bodies))
    matrix[[first, second], [first, second]] = value
    matrix[[first, second], [second, first]] = -value
    return matrix
