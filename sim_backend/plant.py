"""The simulated bench's mechanics and electronics as its devices' firmware meets them.

The firmware sets the amplifiers' inputs and reads encoders, currents and the torque sensor, each in the device's own
positive sense and with its own imperfections. Time moves only when :meth:`Plant.advance` is called.
"""

import math
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

_ROWS = {"actuator": ACTUATOR, "load": LOAD}


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
        # One stream for each signal, so that reading one leaves the others' noise as it is.
        self._noise = {name: np.random.default_rng([seed, k]) for k, name in enumerate(("sensor", *_ROWS))}
        self._drives = {"actuator": truth.actuator} | ({} if truth.load is None else {"load": truth.load})
        self._motors = {machine: drive.motor for machine, drive in self._drives.items()}
        self._state[:, CURRENT_RATE] = RELEASED_RATE_RAD_S
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
        motor = self._motors[machine]
        self._state[_ROWS[machine], CURRENT_TARGET] = motor.Ka * value
        self._state[_ROWS[machine], CURRENT_RATE] = motor.beta

    def release(self, machine: Machine) -> None:
        """From now on the machine's amplifier is off: its current dies away and stays zero."""
        self._state[_ROWS[machine], CURRENT_TARGET] = 0.0
        self._state[_ROWS[machine], CURRENT_RATE] = RELEASED_RATE_RAD_S

    def encoder_position_rad(self, machine: Machine) -> float:
        """The encoder's count at this instant, as an angle in the machine's own sense."""
        counts_per_rad = self._counts_per_rad(machine)
        return math.floor(self.true_position_rad(machine) * counts_per_rad) / abs(counts_per_rad)

    def encoder_velocity_rad_s(self, machine: Machine) -> float:
        """The drive's own estimate of its velocity, tracked from the counts, in the machine's own sense."""
        return float(self._state[_ROWS[machine], TRACKED_RATE]) / abs(self._counts_per_rad(machine))

    def current_a(self, machine: Machine) -> float:
        """One measurement of the torque-producing current, in the machine's own sense."""
        noise = self._drives[machine].current_noise_a * self._noise[machine].standard_normal()
        return self.true_current_a(machine) + noise

    def sensor_torque_nm(self) -> float:
        """One measurement of the torque sensor, in its own sense: bias, drift since the start and noise with it."""
        sensor = self._truth.torque_sensor
        error = sensor.bias_nm + sensor.drift_nm_s * self.now_ns * 1e-9
        noise = sensor.noise_nm * self._noise["sensor"].standard_normal()
        return sensor.mounted * self.true_port_torque_nm() + error + noise

    def true_position_rad(self, machine: Machine) -> float:
        """The machine's angle, in the bench's sense."""
        return float(self._state[_ROWS[machine], ANGLE])

    def true_velocity_rad_s(self, machine: Machine) -> float:
        """The machine's velocity, in the bench's sense."""
        return float(self._state[_ROWS[machine], VELOCITY])

    def true_current_a(self, machine: Machine) -> float:
        """The machine's current, in its own sense."""
        return float(self._state[_ROWS[machine], CURRENT])

    def true_port_torque_nm(self) -> float:
        """The torque that the actuator exerts on what is behind the port; 0 where the shaft is free."""
        twist_rad = self.true_position_rad("actuator") - self.true_position_rad("load")
        slip_rad_s = self.true_velocity_rad_s("actuator") - self.true_velocity_rad_s("load")
        return self._bench.stiffness * twist_rad + self._bench.damping * slip_rad_s

    def _counts_per_rad(self, machine: Machine) -> float:
        return float(self._bench.machines[_ROWS[machine], COUNTS_PER_RAD])
