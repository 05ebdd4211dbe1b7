"""An actuator on a damped spring and its load, integrated by scipy: what trials with it show."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import odeint

from norton_bench.arrays import FloatArray
from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.at_ticks import TickReadings
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.waves import multisine

TICK_S, DURATION_S = 2e-3, 2.0
TICKS = round(DURATION_S / TICK_S)
# The actuator: an inertia on a damped spring, whose other end moves; the load has three times its inertia.
INERTIA_KGM2, DAMPING_NMS_RAD, STIFFNESS_NM_RAD, LOAD_KGM2 = 4e-4, 0.03, 2.0, 1.2e-3
LOAD = Machine(NortonNetwork(1.0, 1000.0, LOAD_KGM2, 1e-4, 1e-6, 1.0, 1e-4, "N*m"), 0.0, 0.0)
TIME_S = TICK_S * np.arange(TICKS)
REST_RAD = np.zeros(round(0.3 / TICK_S))
WAVE_RAD = 0.3 * multisine(DURATION_S - 0.6, TICK_S, low_hz=0.5, high_hz=3.0, seed=4)
SOURCE_RAD = np.concatenate([REST_RAD, WAVE_RAD, REST_RAD])
SOURCE_RAD_S = np.gradient(SOURCE_RAD, TICK_S)
Stiffness = Callable[[float], float]


def moved(load_torque_nm: FloatArray, stiffness: Stiffness, load_kgm2: float) -> tuple[FloatArray, FloatArray]:
    """Position [rad] and the torque of the actuator on its load [N m], both (ticks,)."""
    network, mass = LOAD.network, load_kgm2 + INERTIA_KGM2

    def actuator_nm(now_s: float, position: float, velocity: float) -> float:
        spring = stiffness(now_s) * (np.interp(now_s, TIME_S, SOURCE_RAD) - position)
        return float(spring + DAMPING_NMS_RAD * (np.interp(now_s, TIME_S, SOURCE_RAD_S) - velocity))

    def changes(now_s: float, state: FloatArray) -> list[float]:
        position, velocity, motor_nm = state
        sent_nm = load_torque_nm[min(int(now_s / TICK_S), TICKS - 1)]
        acting_nm = actuator_nm(now_s, position, velocity) + motor_nm
        if load_kgm2:
            acting_nm -= network.viscous_damping_nms_rad * velocity
        return [velocity, acting_nm / mass, network.amplifier_bandwidth_rad_s * (sent_nm - motor_nm)]

    states = odeint(changes, np.zeros(3), TIME_S, tfirst=True, hmax=TICK_S)
    torque_nm = [
        actuator_nm(now_s, *state[:2]) - INERTIA_KGM2 * changes(now_s, state)[1]
        for now_s, state in zip(TIME_S, states, strict=True)
    ]
    return states[:, 0], np.array(torque_nm)


def trial(load_torque_nm: FloatArray, stiffness: Stiffness) -> Trial:
    position_rad, torque_nm = moved(load_torque_nm, stiffness, LOAD_KGM2)
    return Trial(TickReadings(position_rad, position_rad), load_torque_nm, torque_nm)
