"""The paper's second and third condition for a servo, by the network that was fitted: its source is an angle."""

from math import sqrt

from norton_bench.identification.conditions import Condition, Evidence, conditions
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import HALF_INTERVAL
from norton_bench.models.servo_source import SETTLED, settling_in_words, still_to_come, zero_in_words


def servo_conditions(network: NortonNetwork, evidence: Evidence) -> tuple[Condition, ...]:
    """The three of them, in the paper's order."""
    return (conditions(evidence)[0], _unique_zero(network), _zero_dynamics(network))


def _unique_zero(network: NortonNetwork) -> Condition:
    std = 0.0
    if "torque_gain" in network.covariance_names:
        place = network.covariance_names.index("torque_gain")
        std = sqrt(network.covariance[place][place])
    low, high = network.torque_gain - HALF_INTERVAL * std, network.torque_gain + HALF_INTERVAL * std
    holds = None if low <= 0.0 <= high else low > 0.0
    figure = "stiffness about the goal"
    why = zero_in_words(network)
    return Condition("unique zero", holds, why, figure, network.torque_gain, (low, high), "N*m/rad")


def _zero_dynamics(network: NortonNetwork) -> Condition:
    figure = "of a step's change, still to come in the last quarter, by the network"
    left = still_to_come(network)
    return Condition("stable zero dynamics", left <= SETTLED, settling_in_words(left), figure, left)
