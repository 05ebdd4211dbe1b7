"""The simulated bench's mechanics and electronics as its devices' firmware meets them.

The firmware sets the amplifiers' inputs and reads encoders, currents and the torque sensor, each in the device's own
positive sense and with its own imperfections. Time moves only when :meth:`Plant.advance` is called.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from norton_sim import chain, departures, integrator
from norton_sim.integrator import (
    ACTUATOR,
    ANGLE,
    COUNT_OFFSET,
    COUNTS_PER_RAD,
    CURRENT,
    CURRENT_RATE,
    CURRENT_TARGET,
    INVERSE_INERTIA,
    LOAD,
    POWERED,
    STATE_COLUMNS,
    TRACKED_RATE,
    VELOCITY,
)
from norton_sim.packing import PackedBench, pack
from norton_sim.plants.assembled import MODULATOR_BANDWIDTH
from norton_sim.plants.muscles import BEGAN, REACH_COLUMNS
from norton_sim.truth import MotorTruth, Truth

Machine = Literal["actuator", "load", "modulator"]

# Open half-bridges: the winding empties through their diodes against the supply, 100 µH at 2 A and 24 V within 8 µs.
RELEASED_RATE_RAD_S = 1e5

_ROWS: dict[Machine, int] = {"actuator": ACTUATOR, "load": LOAD, "modulator": chain.MODULATOR}
_NOISE_AT_A_TIME = 256

# What a sensor gives for a value that it should give.
Distortion = Callable[[float], float]


@dataclass(slots=True)
class _Machine:
    """One machine's amplifier and encoder, and its rows of the plant's state and parameters."""

    state: "memoryview[float]"
    parameters: "memoryview[float]"
    counts_per_rad: float
    inverse_inertia: float
    torque_constant_nm_a: float = math.nan
    amplifier_gain: float = 0.0
    amplifier_rate_rad_s: float = RELEASED_RATE_RAD_S
    current_noise_a: float = 0.0
    greatest_a: float = math.inf
    released: bool = True
    runaway_a: float | None = None  # what the amplifier follows instead of its command


class Mechanics(NamedTuple):
    """A plant's state (machines, STATE_COLUMNS), its parameters, what it remembers of its reach, and its substep."""

    state: NDArray[np.float64]
    bench: PackedBench
    reach: NDArray[np.float64]
    substep_s: float


class Plant:
    """Actuator with its modulator, torque sensor and load from standstill at ``now_ns`` = 0.

    Parameters: the true values; the seed of all noise; ``shaft``, "free" or "clamped", for a bench without a load;
    ``substep_s``, to integrate with shorter substeps than the bench needs. The same seed and the same calls give the
    same values, bit for bit.
    """

    def __init__(self, truth: Truth, seed: int, shaft: str = "free", *, substep_s: float = math.inf) -> None:
        self.now_ns = 0
        self._truth = truth
        self._bench = pack(truth, shaft)
        self._substep_s = min(substep_s, self._bench.substep_s)
        self._state = np.zeros((len(self._bench.machines), STATE_COLUMNS))
        self._state[:, CURRENT_RATE] = RELEASED_RATE_RAD_S
        # One stream for each signal, so that reading one leaves the others' noise as it is.
        self._noise = {name: _normal(np.random.default_rng([seed, k])) for k, name in enumerate(("sensor", *_ROWS))}
        self._machines = {machine: self._machine(machine) for machine, row in _ROWS.items() if row < len(self._state)}
        self._distortions: tuple[Distortion, ...] = ()  # of the torque sensor
        self._modulator_rad_s = 0.0 if truth.modulator is None else truth.modulator.bandwidth_rad_s
        self._reach = np.zeros(REACH_COLUMNS)
        self._reach[BEGAN] = -math.inf
        self.advance(0)  # compiled here, rather than within the first tick

    def advance(self, to_ns: int) -> None:
        """Let time pass until ``to_ns``. Raises ValueError where that lies in the past."""
        if to_ns < self.now_ns:
            raise ValueError(f"the plant stands at {self.now_ns} ns and cannot go back to {to_ns} ns")
        bench, state, step_s, now_ns = self._bench, self._state, self._substep_s, self.now_ns
        joint = (bench.stiffness, bench.damping)
        if bench.departures is not None:
            departures.advance(state, bench.machines, joint, bench.departures, step_s, now_ns, to_ns)
        elif bench.link is None:
            integrator.advance(state, bench.machines, bench.stiffness, bench.damping, step_s, now_ns, to_ns)
        else:
            chain.advance(state, bench.machines, joint, bench.link, self._reach, step_s, now_ns, to_ns)
        self.now_ns = to_ns

    @property
    def mechanics(self) -> "Mechanics":
        """What an integrator works on that moves this plant together with others; it sets ``now_ns`` as well."""
        return Mechanics(self._state, self._bench, self._reach, self._substep_s)

    def command(self, machine: Machine, value: float) -> None:
        """From now on the machine's amplifier follows ``value``, in its command unit and its own positive sense."""
        driven = self._machines[machine]
        driven.released = False
        wanted_a = driven.amplifier_gain * value
        within_a = min(max(wanted_a, -driven.greatest_a), driven.greatest_a)
        driven.state[CURRENT_TARGET] = within_a if driven.runaway_a is None else driven.runaway_a
        driven.state[CURRENT_RATE] = driven.amplifier_rate_rad_s
        driven.state[POWERED] = 1.0

    def release(self, machine: Machine) -> None:
        """From now on the machine's amplifier is off: its current dies away and stays zero."""
        driven = self._machines[machine]
        driven.released = True
        driven.state[CURRENT_TARGET] = 0.0
        driven.state[CURRENT_RATE] = RELEASED_RATE_RAD_S
        driven.state[POWERED] = 0.0

    def encoder_position_rad(self, machine: Machine) -> float:
        """The encoder's count at this instant, as an angle in the machine's own sense."""
        read = self._machines[machine]
        return _count(read) / abs(read.counts_per_rad)

    def encoder_velocity_rad_s(self, machine: Machine) -> float:
        """The drive's own estimate of its velocity, tracked from the counts, in the machine's own sense."""
        read = self._machines[machine]
        return read.state[TRACKED_RATE] / abs(read.counts_per_rad)

    def current_a(self, machine: Machine) -> float:
        """One measurement of the torque-producing current, in the machine's own sense."""
        noise = self._machines[machine].current_noise_a * next(self._noise[machine])
        return self.true_current_a(machine) + noise

    def sensor_torque_nm(self) -> float:
        """One measurement of the torque sensor, in its own sense: bias, drift since the start and noise with it."""
        sensor = self._truth.torque_sensor
        error = sensor.bias_nm + sensor.drift_nm_s * self.now_ns * 1e-9
        noise = sensor.noise_nm * next(self._noise["sensor"])
        torque_nm = sensor.mounted * self.true_port_torque_nm() + error + noise
        for distort in self._distortions:
            torque_nm = distort(torque_nm)
        return torque_nm

    def true_position_rad(self, machine: Machine) -> float:
        """The machine's angle, in the bench's sense."""
        return self._machines[machine].state[ANGLE]

    def true_velocity_rad_s(self, machine: Machine) -> float:
        """The machine's velocity, in the bench's sense."""
        return self._machines[machine].state[VELOCITY]

    def true_current_a(self, machine: Machine) -> float:
        """The machine's current, in its own sense."""
        return self._machines[machine].state[CURRENT]

    def true_port_torque_nm(self) -> float:
        """The torque that the actuator exerts on what is behind the port; 0 where the shaft is free."""
        actuator, load = self._machines["actuator"].state, self._machines["load"].state
        twist_rad = actuator[ANGLE] - load[ANGLE]
        slip_rad_s = actuator[VELOCITY] - load[VELOCITY]
        return self._bench.stiffness * twist_rad + self._bench.damping * slip_rad_s

    def has(self, machine: Machine) -> bool:
        """Whether there is such a machine, even one that cannot move."""
        return machine in self._machines

    def drives(self, machine: Machine) -> bool:
        """Whether the machine's amplifier heads for a current other than zero."""
        return self._machines[machine].state[CURRENT_TARGET] != 0.0

    # ---- what can break ----

    def misread(self, machine: Machine, gain: int, jump_rad: float = 0.0) -> None:
        """From now on the encoder counts ``gain`` times the motion (1, 0 or -1), on from where it stands plus a jump.

        The drive tracks its velocity from what is counted.
        """
        read = self._machines[machine]
        count = _count(read) + round(jump_rad * abs(read.counts_per_rad))
        read.parameters[COUNTS_PER_RAD] = gain * read.counts_per_rad
        read.parameters[COUNT_OFFSET] = 0.0
        read.parameters[COUNT_OFFSET] = count - _count(read)

    def read_true(self, machine: Machine) -> None:
        """The encoder counts what is there again."""
        read = self._machines[machine]
        read.parameters[COUNTS_PER_RAD] = read.counts_per_rad
        read.parameters[COUNT_OFFSET] = 0.0

    def distort_sensor(self, distortion: Distortion) -> Callable[[], None]:
        """From now on the torque sensor gives what ``distortion`` makes of its reading; returns what ends that."""
        self._distortions = (*self._distortions, distortion)

        def end() -> None:
            self._distortions = tuple(other for other in self._distortions if other is not distortion)

        return end

    def run_away(self, machine: Machine, torque_nm: float) -> None:
        """From now on the amplifier gives the motor this torque, whatever it is commanded, for as long as it is on."""
        driven = self._machines[machine]
        driven.runaway_a = torque_nm / driven.torque_constant_nm_a
        if not driven.released:
            driven.state[CURRENT_TARGET] = driven.runaway_a

    def obey(self, machine: Machine) -> None:
        """The amplifier follows the next command again."""
        self._machines[machine].runaway_a = None

    def jam(self, machine: Machine) -> None:
        """The machine stands at once, and nothing turns it."""
        stuck = self._machines[machine]
        stuck.parameters[INVERSE_INERTIA] = 0.0
        stuck.state[VELOCITY] = 0.0
        self._modulate_at(machine, 0.0)

    def free(self, machine: Machine) -> None:
        """The machine can turn again."""
        stuck = self._machines[machine]
        stuck.parameters[INVERSE_INERTIA] = stuck.inverse_inertia
        self._modulate_at(machine, self._modulator_rad_s)

    def uncouple(self) -> None:
        """The coupling breaks: the two machines know nothing of each other any more."""
        self._bench = replace(self._bench, stiffness=0.0, damping=0.0)

    def _modulate_at(self, machine: Machine, bandwidth_rad_s: float) -> None:
        """How fast the stiffness motor goes where it is sent, if it is that which is meant."""
        if machine == "modulator" and self._bench.link is not None:
            self._bench.link[MODULATOR_BANDWIDTH] = bandwidth_rad_s

    def _machine(self, name: Machine) -> _Machine:
        row = _ROWS[name]
        # The same memory as the integrator's: Python reads a number of it at a third of what numpy asks.
        state, parameters = (
            memoryview(table[row]).cast("B").cast("d") for table in (self._state, self._bench.machines)
        )
        machine = _Machine(state, parameters, parameters[COUNTS_PER_RAD], parameters[INVERSE_INERTIA])
        if name != "load" or self._truth.load is not None:
            truth = self._truth.driven(name)
            machine.torque_constant_nm_a = truth.torque_constant_nm_a
            machine.amplifier_gain = truth.amplifier_gain
            machine.amplifier_rate_rad_s = truth.amplifier_bandwidth_rad_s
            machine.current_noise_a = truth.current_noise_a
            if isinstance(truth, MotorTruth) and truth.current_limit_a is not None:
                machine.greatest_a = truth.current_limit_a
        return machine


def _count(read: _Machine) -> float:
    return math.floor(read.state[ANGLE] * read.parameters[COUNTS_PER_RAD]) + read.parameters[COUNT_OFFSET]


def _normal(random: np.random.Generator) -> Iterator[float]:
    """Standard normal numbers, the same as one by one."""
    while True:
        yield from random.standard_normal(_NOISE_AT_A_TIME).tolist()
