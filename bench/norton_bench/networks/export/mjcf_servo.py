"""What MuJoCo's ``position`` actuator can say of a servo, and what that costs.

Its control has a lag, and a limit holds its force; what it takes off for the joint's angle and velocity has no lag. The
loop of a real drive acts later: on slow motion that is less damping, and another inertia. The expansion of the loop

    K·e^(−δs)·(1 + T·(1 − e^(−Ws))/W)/(1 + s/β) = K + K·(T − δ − 1/β)·s + K·a·s² + …,
    a = 1/β² + δ/β + δ²/2 − T·(1/β + δ + W/2)

gives them, T being the loop's damping over its stiffness, δ its delay, W its window and β the amplifier's bandwidth.
"""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.left_out import without_presliding
from norton_drivers.servo import Servo

# The cost is that of following a goal C·sin(2πft), in per cent of its rms.
FREQUENCY_HZ, PERIODS, TICK_S = 1.0, 4, 1e-3
USUAL_GAPS = 10.0  # C of a network that does not tell its range, over what friction may leave
QUICK_RAD_S = 1e5  # an amplifier without a lag to speak of


@dataclass(frozen=True)
class SlowServo:
    """``stiffness`` [N m/rad], ``damping`` [N m s/rad] and ``inertia`` [kg m²] that slow motion meets, loop included;
    the joint's own damping apart."""

    stiffness: float
    damping: float
    inertia: float


def slow_servo(network: NortonNetwork, servo: Servo) -> SlowServo:
    """Raises UsageError, in a sentence, where no joint of MuJoCo's is like that."""
    stiffness, lag_s = network.torque_gain, 1.0 / network.amplifier_bandwidth_rad_s
    late_s = servo.delay_s
    quadratic = lag_s**2 + late_s * lag_s + 0.5 * late_s**2 - servo.lead_s * (lag_s + late_s + 0.5 * servo.window_s)
    damping = stiffness * (servo.lead_s - late_s - lag_s)
    inertia = network.inertia_kgm2 + stiffness * quadratic
    if stiffness <= 0.0 or damping < 0.0 or inertia <= 0.0:
        raise UsageError(
            "the servo's loop acts so late that MuJoCo's position actuator, which acts at once, has no stiffness, "
            f"damping and inertia like it (damping {damping:.3g} N m s/rad, inertia {inertia:.3g} kg m²)"
        )
    return SlowServo(stiffness, damping, inertia)


def following_costs(network: NortonNetwork, slow: SlowServo) -> str:
    """What the loop's lag and presliding cost that MuJoCo has not: rms of the place under a goal, and which goal."""
    ranges = {} if network.prediction is None else network.prediction.ranges
    usual = USUAL_GAPS * network.coulomb_torque_nm / network.torque_gain
    reach = max(abs(end) for end in ranges.get("command", (-usual, usual)))
    goal = reach * np.sin(2 * np.pi * FREQUENCY_HZ * TICK_S * np.arange(round(PERIODS / FREQUENCY_HZ / TICK_S)))
    decay = np.exp(-network.amplifier_bandwidth_rad_s * TICK_S)
    whole = network.free_motion(goal, TICK_S)[0]
    rest = _at_once(network, slow).free_motion(_lagged(goal, float(decay)), TICK_S)[0]
    share = 100.0 * float(np.sqrt(np.mean((whole - rest) ** 2) / np.mean(whole**2)))
    return f"{share:.2g} % of the place's rms, under a goal of {reach:.3g} rad · sin(2π·{FREQUENCY_HZ:g} Hz·t)"


def _at_once(network: NortonNetwork, slow: SlowServo) -> NortonNetwork:
    servo = Servo(slow.stiffness, slow.damping)
    plain = replace(network, servo=servo, inertia_kgm2=slow.inertia, amplifier_bandwidth_rad_s=QUICK_RAD_S, terms=())
    return without_presliding(plain)


def _lagged(goal: FloatArray, decay: float) -> FloatArray:
    from norton_bench.models import network_steps  # noqa: PLC0415  (compiled: slow to import)

    return network_steps.lagged(goal, decay, 0.0)
