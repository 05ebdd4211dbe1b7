"""The source of a servo: how near to its goal friction lets it rest, and how a step settles."""

from math import inf

import numpy as np

from norton_bench.models.network import NortonNetwork

# A step of the command by this many times what friction may leave, seen for so long.
STEP_GAPS, DWELL_S, TICK_S = 20.0, 0.4, 1e-3
# Of the step, still to come in the last quarter: as little as this where it settles.
SETTLED = 0.1


def gap(network: NortonNetwork) -> float:
    """How far from its command friction may hold the free shaft, to either side [rad or rad/s]."""
    return network.coulomb_torque_nm / abs(network.torque_gain)


def still_to_come(network: NortonNetwork) -> float:
    """Of a step of the command at zero torque, what comes in the last quarter of DWELL_S; infinite if it runs away."""
    ticks = round(DWELL_S / TICK_S)
    step = STEP_GAPS * gap(network)
    motion = network.dissipative().free_motion(np.full(ticks, step), TICK_S)
    follows = motion[0 if network.holds_position else 1]
    return float(np.ptp(follows[-ticks // 4 :]) / step) if np.isfinite(follows).all() else inf


def zero_in_words(network: NortonNetwork) -> str:
    """Where its torque vanishes."""
    return (
        f"the torque pulls to the goal; at rest friction may hold the shaft within ± {1e3 * gap(network):.3g} mrad "
        "of it"
    )


def settling_in_words(left: float) -> str:
    """Whether a step settles."""
    settles = "settles" if left <= SETTLED else "does not settle"
    return f"with no torque at the port, a step of the command {settles} within {DWELL_S:g} s"
