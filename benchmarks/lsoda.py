"""One simulation of the paper's motor by scipy's LSODA, as fast as ``solve_ivp`` makes it.

One call for the whole record; its inputs go in straight lines from tick to tick, so that it need not stop at each;
tolerances are relative 1e-6 and absolute a millionth of each state; output every tick. The equations are plain floats
in Python, or compiled by numba.
"""

import time
from typing import Any

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from norton_bench.arrays import FloatArray
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import Signals

USUAL_RAD_S = 10.0


def rates(time_s: float, state: Any, tick_s: float, command: Any, torque: Any, values: Any) -> tuple[float, ...]:
    """Section IV.D with the drive's torque for its current: see norton_bench.models.parameters."""
    gain, bandwidth, inertia, damping, coulomb, stiffness, contact_damping = values
    at = time_s / tick_s
    k = min(int(at), len(command) - 2)
    share = at - k
    drive, omega, phi = state[0], state[1], state[2]
    phi_rate = omega - stiffness / coulomb * abs(omega) * phi
    friction = stiffness * phi + contact_damping * phi_rate + damping * omega
    port = torque[k] + share * (torque[k + 1] - torque[k])
    asked = gain * (command[k] + share * (command[k + 1] - command[k]))
    return bandwidth * (asked - drive), (drive - port - friction) / inertia, phi_rate


compiled_rates = njit(rates)


def simulate(stretches: tuple[Signals, ...], found: FitResult, *, compiled: bool) -> float:
    """Processor seconds from command and port torque to motion, once, with the fit's own values and delays."""
    tick_s = stretches[0].tick_s
    command, torque = _inputs(stretches, found.command_delay_s)
    values = tuple(found.estimate(name).value for name in PHYSICAL)
    given = (tick_s, command, torque, values) if compiled else (tick_s, command.tolist(), torque.tolist(), values)

    def plain(time_s: float, state: FloatArray, *args: Any) -> tuple[float, ...]:
        return rates(time_s, state.tolist(), *args)

    compiled_rates(0.0, np.zeros(3), tick_s, command, torque, values)
    coulomb, stiffness = values[4:6]
    instants_s = np.arange(len(command)) * tick_s
    begun_s = time.process_time()
    solved = solve_ivp(
        compiled_rates if compiled else plain,
        (0.0, instants_s[-1]),
        np.zeros(3),
        method="LSODA",
        t_eval=instants_s,
        args=given,
        rtol=1e-6,
        atol=1e-6 * np.array([coulomb, USUAL_RAD_S, coulomb / stiffness]),
    )
    took_s = time.process_time() - begun_s
    assert solved.success
    return took_s


def _inputs(stretches: tuple[Signals, ...], delay_s: float) -> tuple[FloatArray, FloatArray]:
    """Command and port torque at every tick, one stretch after the other."""
    commands, torques = [], []
    for each in stretches:
        held = np.searchsorted(each.sent_s + delay_s, each.time_s, "right") - 1
        commands.append(each.command[np.maximum(held, 0)])
        assert each.torque_nm is not None
        torques.append(each.torque_nm)
    return np.concatenate(commands), np.concatenate(torques)
