"""Tables of springs, with backlash or without, as if they had been held."""

import numpy as np

from norton_bench.identification.averages import Mean, Setting
from norton_bench.identification.exertion_table import ExertionTable, Held

NOISE_NM = 1e-3
HELD = Setting(0.2)


def table(exerted, friction_nm=0.0, reach_rad=0.05, seed=0) -> ExertionTable:
    """Held at nine places in both directions; friction resists the way in which each was reached."""
    random, held = np.random.default_rng(seed), []
    for rising in (True, False):
        for place in np.linspace(-reach_rad, reach_rad, 9):
            away = place + random.uniform(-1e-4, 1e-4)
            torque_nm = exerted(away) - (friction_nm if rising else -friction_nm)
            half = 2.57 * NOISE_NM
            held.append(Held(HELD, away, rising, Mean(torque_nm + NOISE_NM * random.standard_normal(), half)))
    return ExertionTable(tuple(held), (), {HELD: Mean(0.5, 1e-5)})


def backlash(stiffness, width):
    def exerted(away):
        return -stiffness * (away - min(max(away, -width / 2), width / 2))

    return exerted
