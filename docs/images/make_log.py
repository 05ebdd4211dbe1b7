"""The log and the picture of docs/logs.md: a motor that follows three waves, and the figure of its report.

python docs/images/make_log.py      # writes examples/logs/joint.csv and docs/images/log.svg
"""

from pathlib import Path

import numpy as np

from norton_bench.logs.column_map import parse_map
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.propose import propose
from norton_bench.report.figures_fit import validation_figure
from norton_bench.report.svg import standalone, style, svg

ROOT = Path(__file__).parents[2]
LOG = ROOT / "examples" / "logs" / "joint.csv"
GAIN_NM_A, INERTIA_KG_M2, DAMPING_NM_S_RAD, COULOMB_NM = 0.8, 0.02, 0.15, 0.1
RATE_HZ, DURATION_S = 200.0, 15.0
STEP_DEG, NOISE_A = 0.005, 0.01
AMPLITUDES_RAD = np.array([[1.0], [0.4], [0.15]])
FREQUENCIES_HZ = np.array([[0.31], [0.83], [2.7]])
PHASES_RAD = np.array([[0.3], [1.1], [2.0]])


def write_log() -> None:
    """As an encoder and a current probe that is connected the wrong way round would see it."""
    time_s = np.arange(int(RATE_HZ * DURATION_S)) / RATE_HZ
    wave_rad_s = 2 * np.pi * FREQUENCIES_HZ
    phase = wave_rad_s * time_s + PHASES_RAD
    angle_rad = np.sum(AMPLITUDES_RAD * np.sin(phase), axis=0)
    velocity_rad_s = np.sum(AMPLITUDES_RAD * wave_rad_s * np.cos(phase), axis=0)
    acceleration_rad_s2 = -np.sum(AMPLITUDES_RAD * wave_rad_s**2 * np.sin(phase), axis=0)
    torque_nm = INERTIA_KG_M2 * acceleration_rad_s2 + DAMPING_NM_S_RAD * velocity_rad_s
    torque_nm += COULOMB_NM * np.sign(velocity_rad_s)
    noise_a = NOISE_A * np.random.default_rng(1).standard_normal(time_s.size)
    angle_deg = STEP_DEG * np.round(np.rad2deg(angle_rad) / STEP_DEG)
    rows = np.stack([time_s, angle_deg, -(torque_nm / GAIN_NM_A + noise_a)], axis=1)
    np.savetxt(LOG, rows, delimiter=",", header="t [s],angle [deg],current [A]", comments="", fmt="%.3f")


def write_picture() -> None:
    """The first figure of the report, with the gain known and the last third as the test."""
    text, _ = propose(LOG)
    column_map = parse_map(f'{text}torque_gain = "{GAIN_NM_A} N*m/A"\n', place="joint.map.toml")
    fit = fit_logs(Request((LOG,), column_map, test="10: s"))
    assert fit.exertion is not None
    with style():
        drawn = svg(validation_figure(fit.exertion, "exertion"), "log", "Torque as logged and as fitted.")
    (ROOT / "docs" / "images" / "log.svg").write_text(standalone(drawn), encoding="utf-8")


if __name__ == "__main__":
    write_log()
    write_picture()
