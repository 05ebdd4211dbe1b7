"""A bench to try the controller on: two inertias with Dahl friction and a compliant torque sensor between them, behind
asynchronous links with delay, noise and quantisation. Written apart from the simulated backend, on purpose.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.sample import Sample

SUBSTEPS = 100


@dataclass(frozen=True)
class Side:
    """One machine: amplifier, inertia and Dahl friction."""

    gain: float
    beta: float
    inertia: float
    damping: float
    coulomb: float
    sigma_0: float
    sigma_1: float

    def scaled(self, factor: float) -> "Side":
        """Every mechanical value times ``factor``, the amplifier's bandwidth too."""
        return Side(
            self.gain,
            self.beta * factor,
            self.inertia * factor,
            self.damping * factor,
            self.coulomb * factor,
            self.sigma_0 * factor,
            self.sigma_1 * factor,
        )

    def row(self) -> list[float]:
        return [self.gain, self.beta, self.inertia, self.damping, self.coulomb, self.sigma_0, self.sigma_1]


ACTUATOR = Side(gain=0.9, beta=600, inertia=5e-5, damping=1e-3, coulomb=0.02, sigma_0=10, sigma_1=0.01)
LOAD = Side(gain=0.95, beta=1000, inertia=1.2e-4, damping=3e-4, coulomb=8e-3, sigma_0=8, sigma_1=0.005)


@dataclass(frozen=True)
class PlantSettings:
    """What the test bench is made of; delays and jitters in seconds."""

    actuator: Side = ACTUATOR
    load: Side = LOAD
    stiffness: float = 200.0
    damping: float = 0.01
    torque_noise_nm: float = 1e-3
    torque_bias_nm: float = 0.0
    counts_per_turn: int = 131072
    can_delay_s: float = 250e-6
    can_jitter_s: float = 50e-6
    serial_delay_s: float = 400e-6
    serial_jitter_s: float = 100e-6
    cogging_nm: float = 0.3e-3
    seed: int = 1

    def calibration(self, errors: dict[str, float] | None = None) -> LoadCalibration:
        """What a perfect calibration would say, each value named in ``errors`` off by that factor."""
        values = {
            "torque_gain": self.load.gain,
            "amplifier_bandwidth_rad_s": self.load.beta,
            "inertia_kgm2": self.load.inertia,
            "viscous_damping_nms_rad": self.load.damping,
            "coulomb_torque_nm": self.load.coulomb,
            "presliding_stiffness_nm_rad": self.load.sigma_0,
            "presliding_damping_nms_rad": self.load.sigma_1,
            "command_delay_s": self.can_delay_s,
            "measurement_delay_s": self.serial_delay_s,
            "motion_delay_s": self.can_delay_s,
            "sensor_stiffness_nm_rad": self.stiffness,
            "sensor_damping_nms_rad": self.damping,
            "torque_noise_nm": self.torque_noise_nm,
            "torque_bias_nm": self.torque_bias_nm,
            "position_resolution_rad": 2 * pi / self.counts_per_turn,
        }
        for name, factor in (errors or {}).items():
            values[name] *= factor
        return LoadCalibration(**values)


@njit(cache=True)
def _friction(side: FloatArray, velocity: float, phi: float) -> float:
    rate = velocity - side[5] / side[4] * abs(velocity) * phi
    return side[5] * phi + side[6] * rate + side[3] * velocity


@njit(cache=True)
def _advance(x, actuator, load, sensor, u_actuator, u_load, dt, cogging):  # type: ignore[no-untyped-def]
    """One substep of the state [θm, ωm, φm, Tm, θl, ωl, φl, Tl], in place (symplectic; Dahl by its exact flow)."""
    x[3] += (actuator[0] * u_actuator - x[3]) * (1 - np.exp(-actuator[1] * dt))
    x[7] += (load[0] * u_load - x[7]) * (1 - np.exp(-load[1] * dt))
    port = sensor[0] * (x[0] - x[4]) + sensor[1] * (x[1] - x[5])
    x[1] += dt * (x[3] + cogging * np.sin(42 * x[0]) - port - _friction(actuator, x[1], x[2])) / actuator[2]
    x[5] += dt * (x[7] + port - _friction(load, x[5], x[6])) / load[2]
    for position, phi, side in ((0, 2, actuator), (4, 6, load)):
        step = dt * x[position + 1]
        x[position] += step
        limit = side[4] / side[5] * np.sign(step)
        x[phi] = limit + (x[phi] - limit) * np.exp(-side[5] / side[4] * abs(step))
    return port


@njit(cache=True)
def _tick(x, actuator, load, sensor, queue, now, dt, cogging, instants, taken):  # type: ignore[no-untyped-def]
    """One tick of substeps. ``queue`` holds (time, actuator command, load command) in force from that time on;
    at each of ``instants`` the state (τ, θm, θl) is put in ``taken``. Returns the sum of squares of the port torque."""
    square = 0.0
    for step in range(SUBSTEPS):
        t = now + step * dt
        u_actuator, u_load = queue[0, 1], queue[0, 2]
        for row in range(queue.shape[0]):
            if queue[row, 0] <= t:
                u_actuator, u_load = queue[row, 1], queue[row, 2]
        port = _advance(x, actuator, load, sensor, u_actuator, u_load, dt, cogging)
        square += port * port
        for i in range(instants.size):
            if t <= instants[i] < t + dt:
                taken[i, 0] = port
                taken[i, 1] = x[0]
                taken[i, 2] = x[4]
    return square


class Plant:
    """The bench: ``sample()`` gives what the host knows at this tick, ``step`` sends commands and lets a tick pass."""

    def __init__(self, settings: PlantSettings = PlantSettings(), tick_s: float = 1e-3) -> None:
        self.settings = settings
        self.tick_s = tick_s
        self.now = 0.0
        self.state = np.zeros(8)
        self.mean_square = 0.0
        self._rng = np.random.default_rng(settings.seed)
        self._actuator = np.array(settings.actuator.row())
        self._load = np.array(settings.load.row())
        self._sensor = np.array([settings.stiffness, settings.damping])
        self._queue = np.zeros((4, 3))
        self._next = self._rng.uniform(0, tick_s, 3)  # phase of torque sensor, actuator's encoder, load's encoder
        self._period = tick_s * (1 + np.array([30e-6, -20e-6, 15e-6]))
        self._flying: list[tuple[float, int, float]] = []
        self._known = [(np.nan, -1.0)] * 3
        self._velocity = [0.0, 0.0]
        self._held_from, self._held_until = 0.0, 0.0
        self._held: set[int] = set()

    def hold_readings(self, for_s: float) -> None:
        """What arrives in the next ``for_s`` comes at their end: one of each signal, and the others within a tick."""
        self._held_from, self._held_until = self.now, self.now + for_s
        self._held.clear()

    def sample(self) -> Sample:
        count = [0] * 3
        for arrival, which, value in [m for m in self._flying if m[0] <= self.now]:
            self._known[which] = (value, arrival)
            count[which] += 1
        self._flying = [m for m in self._flying if m[0] > self.now]
        ages = [int((self.now - arrival) * 1e9) if arrival >= 0 else -1 for _, arrival in self._known]
        return Sample(
            tick_ns=round(self.now * 1e9),
            torque_nm=self._known[0][0],
            torque_age_ns=ages[0],
            torque_new=count[0] > 0,
            position_rad=self._known[1][0],
            velocity_rad_s=self._velocity[0],
            motion_age_ns=ages[1],
            motion_new=count[1] > 0,
            load_position_rad=self._known[2][0],
            load_velocity_rad_s=self._velocity[1],
            load_motion_age_ns=ages[2],
            load_motion_new=count[2] > 0,
            torque_count=count[0],
            motion_count=count[1],
            load_motion_count=count[2],
        )

    def step(self, actuator_command: float, load_command: float) -> None:
        s = self.settings
        delay = s.can_delay_s + self._rng.uniform(0, s.can_jitter_s)
        self._queue = np.vstack([self._queue[1:], [self.now + delay, actuator_command, load_command]])
        taken = np.full((3, 3), np.nan)
        self.mean_square = (
            _tick(
                self.state, self._actuator, self._load, self._sensor, self._queue, self.now,
                self.tick_s / SUBSTEPS, s.cogging_nm, self._next, taken,
            )
            / SUBSTEPS
        )  # fmt: skip
        self.now += self.tick_s
        self._post(taken)

    def _post(self, taken: FloatArray) -> None:
        s = self.settings
        count = 2 * pi / s.counts_per_turn
        for which, (port, actuator, load) in enumerate(taken):
            if np.isnan(port):
                continue
            if which == 0:
                value = port + s.torque_bias_nm + s.torque_noise_nm * self._rng.standard_normal()
                delay = s.serial_delay_s + self._rng.uniform(0, s.serial_jitter_s)
            else:
                value = np.floor((actuator if which == 1 else load) / count) * count
                delay = s.can_delay_s + self._rng.uniform(0, s.can_jitter_s)
            arrival = self._next[which] + delay
            if self._held_from < arrival < self._held_until:
                first = which not in self._held
                self._held.add(which)
                arrival = self._held_until + (0.0 if first else 0.5 * self.tick_s)
            self._flying.append((arrival, which, float(value)))
            self._next[which] += self._period[which]
        self._velocity = [float(self.state[1]), float(self.state[5])]
