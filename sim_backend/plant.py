"""The simulated bench's mechanics and electronics as its devices' firmware meets them.

The firmware sets the amplifiers' inputs and reads encoders, currents and the torque sensor, each in the device's own
positive sense and with its own imperfections. Time moves only when :meth:`Plant.advance` is called.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim_backend.integrator import (
    ACTUATOR,
    ANGLE,
    COUNTS_PER_RAD,
    CURRENT,
    CURRENT_RATE,
    CURRENT_TARGET,
    LOAD,
    STATE_COLUMNS,
    TRACKED_RATE,
    VELOCITY,
    advance,
)
from sim_backend.packing import pack
from sim_backend.truth import Truth

Machine = Literal["actuator", "load"]

# An open half-bridge: the winding's inductance empties within a fraction of a millisecond.
RELEASED_RATE_RAD_S = 10_000.0

_ROWS: dict[Machine, int] = {"actuator": ACTUATOR, "load": LOAD}
_NOISE_AT_A_TIME = 256


@dataclass(slots=True)
class _Machine:
    """One machine's amplifier and encoder, and its row of the plant's state."""

    state: "memoryview[float]"
    counts_per_rad: float
    amplifier_gain: float = 0.0
    amplifier_rate_rad_s: float = RELEASED_RATE_RAD_S
    current_noise_a: float = 0.0


class Plant:
    """Actuator, torque sensor and load from standstill at ``now_ns`` = 0.

    Parameters: the true values; the seed of all noise; ``shaft``, "free" or "clamped", for a bench without a load;
    ``substep_s``, to integrate with shorter substeps than the bench needs. The same seed and the same calls give the
    same values, bit for bit.
    """

    def __init__(self, truth: Truth, seed: int, shaft: str = "free", *, substep_s: float = math.inf) -> None:
        self.now_ns = 0
        self._truth = truth
        self._bench = pack(truth, shaft)
        self._substep_s = min(substep_s, self._bench.substep_s)
        self._state = np.zeros((2, STATE_COLUMNS))
        self._state[:, CURRENT_RATE] = RELEASED_RATE_RAD_S
        # One stream for each signal, so that reading one leaves the others' noise as it is.
        self._noise = {name: _normal(np.random.default_rng([seed, k])) for k, name in enumerate(("sensor", *_ROWS))}
        self._machines = {machine: self._machine(machine) for machine in _ROWS}
        self.advance(0)  # compiled here, rather than within the first tick

    def advance(self, to_ns: int) -> None:
        """Let time pass until ``to_ns``. Raises ValueError where that lies in the past."""
        if to_ns < self.now_ns:
            raise ValueError(f"the plant stands at {self.now_ns} ns and cannot go back to {to_ns} ns")
        bench = self._bench
        advance(self._state, bench.machines, bench.stiffness, bench.damping, self._substep_s, self.now_ns, to_ns)
        self.now_ns = to_ns

    def command(self, machine: Machine, value: float) -> None:
        """From now on the machine's amplifier follows ``value``, in its command unit and its own positive sense."""
        driven = self._machines[machine]
        driven.state[CURRENT_TARGET] = driven.amplifier_gain * value
        driven.state[CURRENT_RATE] = driven.amplifier_rate_rad_s

    def release(self, machine: Machine) -> None:
        """From now on the machine's amplifier is off: its current dies away and stays zero."""
        state = self._machines[machine].state
        state[CURRENT_TARGET] = 0.0
        state[CURRENT_RATE] = RELEASED_RATE_RAD_S

    def encoder_position_rad(self, machine: Machine) -> float:
        """The encoder's count at this instant, as an angle in the machine's own sense."""
        read = self._machines[machine]
        return math.floor(read.state[ANGLE] * read.counts_per_rad) / abs(read.counts_per_rad)

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
        return sensor.mounted * self.true_port_torque_nm() + error + noise

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

    def _machine(self, name: Machine) -> _Machine:
        truth = self._truth.actuator if name == "actuator" else self._truth.load
        row = _ROWS[name]
        # The same memory as the integrator's: Python reads a number of it at a third of what numpy asks.
        state = memoryview(self._state[row]).cast("B").cast("d")
        machine = _Machine(state, float(self._bench.machines[row, COUNTS_PER_RAD]))
        if truth is not None:
            machine.amplifier_gain, machine.amplifier_rate_rad_s = truth.motor.Ka, truth.motor.beta
            machine.current_noise_a = truth.current_noise_a
        return machine


def _normal(random: np.random.Generator) -> Iterator[float]:
    """Standard normal numbers, the same as one by one."""
    while True:
        yield from random.standard_normal(_NOISE_AT_A_TIME).tolist()
