"""What a servo of MuJoCo's, of position or velocity, can say of a drive's, and what that costs.

Its control has a lag, and a limit holds its force; what it takes off for the joint's angle and velocity has no lag. The
loop of a real drive acts later: on slow motion that is less damping, and another inertia. The expansion of the loop

    K·e^(−δs)·(P + T·(1 − e^(−Ws))/W)/(1 + s/β) = K·P + K·(T − P·(δ + 1/β))·s + K·a·s² + …,
    a = P·(1/β² + δ/β + δ²/2) − T·(1/β + δ + W/2)

gives them: P is 1 and T the loop's damping over its stiffness where the command is a position, P is 0 and T is 1 where
it is a velocity; δ is the loop's delay, W its window and β the amplifier's bandwidth.
"""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.left_out import without_presliding
from norton_drivers.servo import Servo

# The cost is that of following a command C·sin(2πft), in per cent of its rms.
FREQUENCY_HZ, PERIODS, TICK_S = 1.0, 4, 1e-3
USUAL_GAPS = 10.0  # C of a network that does not tell its range, over what friction may leave
QUICK_RAD_S = 1e5  # an amplifier without a lag to speak of


@dataclass(frozen=True)
class SlowServo:
    """``gain`` [N m per unit of the command], ``damping`` [N m s/rad] and ``inertia`` [kg m²] that slow motion meets,
    loop included; the joint's own damping apart."""

    gain: float
    damping: float
    inertia: float


def slow_servo(network: NortonNetwork, servo: Servo) -> SlowServo:
    """Raises UsageError, in a sentence, where no joint of MuJoCo's is like that."""
    gain, lag_s, late_s = network.torque_gain, 1.0 / network.amplifier_bandwidth_rad_s, servo.delay_s
    quadratic = servo.of_angle * (lag_s**2 + late_s * lag_s + 0.5 * late_s**2)
    quadratic -= servo.of_velocity * (lag_s + late_s + 0.5 * servo.window_s)
    damping = gain * (servo.of_velocity - servo.of_angle * (late_s + lag_s))
    inertia = network.inertia_kgm2 + gain * quadratic
    if gain <= 0.0 or damping < 0.0 or inertia <= 0.0:
        raise UsageError(
            "the servo's loop acts so late that MuJoCo's actuators, which act at once, have no gain, damping and "
            f"inertia like it (damping {damping:.3g} N m s/rad, inertia {inertia:.3g} kg m²)"
        )
    return SlowServo(gain, damping, inertia)


def following_costs(network: NortonNetwork, slow: SlowServo) -> str:
    """What the loop's lag and presliding cost that MuJoCo has not: rms of place or velocity, and under what command."""
    ranges = {} if network.prediction is None else network.prediction.ranges
    usual = USUAL_GAPS * network.coulomb_torque_nm / network.torque_gain
    reach = max(abs(end) for end in ranges.get("command", (-usual, usual)))
    goal = reach * np.sin(2 * np.pi * FREQUENCY_HZ * TICK_S * np.arange(round(PERIODS / FREQUENCY_HZ / TICK_S)))
    decay = np.exp(-network.amplifier_bandwidth_rad_s * TICK_S)
    followed, what = (0, "place") if network.holds_position else (1, "velocity")
    whole = network.free_motion(goal, TICK_S)[followed]
    rest = _at_once(network, slow).free_motion(_lagged(goal, float(decay)), TICK_S)[followed]
    share = 100.0 * float(np.sqrt(np.mean((whole - rest) ** 2) / np.mean(whole**2)))
    command = f"{reach:.3g} {network.command_unit} · sin(2π·{FREQUENCY_HZ:g} Hz·t)"
    return f"{share:.2g} % of the {what}'s rms, under a command of {command}"


def _at_once(network: NortonNetwork, slow: SlowServo) -> NortonNetwork:
    servo = Servo(slow.gain if network.holds_position else 0.0, slow.damping)
    plain = replace(network, servo=servo, inertia_kgm2=slow.inertia, amplifier_bandwidth_rad_s=QUICK_RAD_S, terms=())
    return without_presliding(plain)


def _lagged(goal: FloatArray, decay: float) -> FloatArray:
    from norton_bench.models import network_steps  # noqa: PLC0415  (compiled: slow to import)

    return network_steps.lagged(goal, decay, 0.0)
