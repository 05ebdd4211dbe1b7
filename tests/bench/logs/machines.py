"""Logs whose truth is known in closed form: the motion is a sum of sines, and the exertion follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.logs.column_map import ColumnMap, parse_map
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.results import LogFit
from norton_bench.models.parameters import Estimate

Columns = dict[str, FloatArray]

AMPLITUDES = np.array([1.0, 0.4, 0.15])
FREQUENCIES_HZ = np.array([0.31, 0.83, 2.7])


@dataclass(frozen=True)
class Machine:
    """``gain · u = I a + B v + τc sgn v + offset + port``."""

    gain: float = 2.0
    inertia: float = 0.05
    damping: float = 0.3
    coulomb: float = 0.8
    offset: float = -0.1
    rate_hz: float = 500.0
    duration_s: float = 20.0
    noise: float = 0.005
    seed: int = 1
    phases: tuple[float, ...] = field(default=(0.3, 1.1, 2.0))

    def motion(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration."""
        wave = 2 * np.pi * FREQUENCIES_HZ
        angle = wave[:, None] * time_s + np.array(self.phases)[:, None]
        position = AMPLITUDES @ np.sin(angle)
        velocity = (AMPLITUDES * wave) @ np.cos(angle)
        return position, velocity, -(AMPLITUDES * wave**2) @ np.sin(angle)

    def needed(self, time_s: FloatArray) -> FloatArray:
        """The exertion that the motion takes."""
        _, v, a = self.motion(time_s)
        return self.inertia * a + self.damping * v + self.coulomb * np.sign(v) + self.offset

    def log(self, time_s: FloatArray | None = None) -> Columns:
        """``t, q, w, u`` of a free port, and ``u2, tau`` of a port at which something else drives too."""
        rng = np.random.default_rng(self.seed)
        t = np.arange(int(self.duration_s * self.rate_hz)) / self.rate_hz if time_s is None else time_s
        q, v, _ = self.motion(t)
        needed = self.needed(t)
        u2 = 0.6 * np.sin(2 * np.pi * 0.57 * t) + 0.5 * np.sin(2 * np.pi * 1.9 * t + 1.0)
        noise = self.noise * rng.standard_normal((3, t.size))
        return {
            "t": t,
            "q": q + 1e-5 * rng.standard_normal(t.size),
            "w": v + noise[2],
            "u": needed / self.gain + noise[0],
            "u2": u2,
            "tau": self.gain * u2 - needed + noise[1],
        }


FREE = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "q", unit = "rad" }
command = { name = "u", unit = "A" }
[actuator]
torque_gain = "2 N*m/A"
[model]
friction = "coulomb-viscous"
candidates = ["coulomb-viscous"]
"""
LOADED = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "q", unit = "rad" }
command = { name = "u2", unit = "A" }
exertion = { name = "tau", unit = "N*m" }
[model]
friction = "coulomb-viscous"
candidates = ["coulomb-viscous"]
"""


def column_map(text: str) -> ColumnMap:
    return parse_map(text, place="map.toml")


def write_csv(path: Path, columns: Mapping[str, FloatArray]) -> Path:
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    return path


def fit_of(folder: Path, columns: Mapping[str, FloatArray], text: str = FREE, **options: str) -> LogFit:
    """The fit of one log."""
    path = write_csv(folder / "log.csv", columns)
    return fit_logs(Request((path,), column_map(text), **options))


def estimate(fit: LogFit, name: str) -> Estimate:
    return {each.name: each for each in fit.estimates}[name]
