"""What it costs to leave a part of an identified motor out: the share of the torque's rms that is then wrong.

The torque is that at the port under one standard motion, which is told with the figure:

    ω = Ω·sin(2πft),  c = C·sin(2π√5·ft),  ten periods of ω

with Ω and C as great as the network was seen to hold with (``prediction.ranges`` of its file), about the middle of
these ranges. A network that does not tell takes three times its breakaway command for C, as a picture of it shows, and
for Ω the free velocity at that command. The frequency f is 1 Hz, or less where the acceleration would leave its range.
√5 is far from every ratio of small integers, so all combinations of velocity and command occur.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import command_shown
from norton_bench.models.terms import TERM_BY_NAME, NetworkTerm, joint_of

PERIODS = 10
TICKS_PER_PERIOD = 2000
RATIO = 5**0.5
FREQUENCY_HZ = 1.0
# A contact so much stiffer has no presliding to speak of: its torque is that of a dry friction.
STIFFER = 1e4


@dataclass(frozen=True)
class ExportedModel:
    """``text`` of a file, and in sentences what it leaves out of the network."""

    text: str
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class StandardMotion:
    """Command and position [rad] at ticks of ``tick_s``, shape (n,); ``words`` say how far they go.

    ``fastest_rad_s`` is the greatest magnitude of the velocity.
    """

    command: FloatArray
    position_rad: FloatArray
    tick_s: float
    fastest_rad_s: float
    words: str


def standard_motion(network: NortonNetwork) -> StandardMotion:
    """The motion that costs are reckoned under."""
    ranges = {} if network.prediction is None else network.prediction.ranges
    shown = command_shown(network)
    lowest, highest = ranges.get("command", (-shown, shown))
    reach = max(abs(lowest), abs(highest))
    free = float(np.abs(network.source_velocity(np.array([-reach, reach]))).max())
    free = free if 0.0 < free < np.inf else 1.0
    slowest, fastest = ranges.get("velocity", (-free, free))
    amplitude, low, high = 0.5 * (fastest - slowest), *ranges.get("acceleration", (-np.inf, np.inf))
    frequency_hz = min(FREQUENCY_HZ, max(abs(low), abs(high)) / (2 * np.pi * amplitude))
    tick_s = 1.0 / (frequency_hz * TICKS_PER_PERIOD)
    phase = 2 * np.pi * np.arange(PERIODS * TICKS_PER_PERIOD) / TICKS_PER_PERIOD
    position = amplitude / (2 * np.pi * frequency_hz) * (1.0 - np.cos(phase))
    position += 0.5 * (fastest + slowest) * tick_s * np.arange(phase.size)
    command = 0.5 * (lowest + highest) + 0.5 * (highest - lowest) * np.sin(RATIO * phase)
    words = (
        f"velocities from {slowest:.3g} to {fastest:.3g} rad/s, "
        f"commands from {lowest:.3g} to {highest:.3g} {network.command_unit}".strip()
    )
    return StandardMotion(command, position, tick_s, max(abs(slowest), abs(fastest)), words)


def cost_percent(network: NortonNetwork, without: NortonNetwork, motion: StandardMotion) -> float:
    """Rms difference of the two networks' torque, in per cent of the rms torque of ``network``."""
    whole, rest = (each.torque(motion.command, motion.position_rad, motion.tick_s) for each in (network, without))
    return float(100.0 * np.sqrt(np.mean((whole - rest) ** 2) / np.mean(whole**2)))


def without_terms(network: NortonNetwork, names: Sequence[str]) -> NortonNetwork:
    """The network without its terms of these names; without a joint, what turned beyond it turns with the motor."""
    joint = joint_of(network.terms)
    if joint is not None and joint.name in names:
        network = network.rigid
    return replace(network, terms=tuple(term for term in network.terms if term.name not in names))


def without_presliding(network: NortonNetwork) -> NortonNetwork:
    """The network with dry friction of the same strength."""
    stiff = STIFFER * network.presliding_stiffness_nm_rad
    return replace(network, presliding_stiffness_nm_rad=stiff, presliding_damping_nms_rad=0.0)


def presliding_sentence(network: NortonNetwork) -> str:
    """What is lost where friction is dry, and what that costs."""
    reach = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
    motion = standard_motion(network)
    cost = cost_percent(network, without_presliding(network), motion)
    return (
        f"Presliding is left out: dry friction holds without a spring, where the contact yields by {reach:.3g} rad "
        f"(sigma_0 = {network.presliding_stiffness_nm_rad:.4g} N m/rad, "
        f"sigma_1 = {network.presliding_damping_nms_rad:.4g} N m s/rad) before it slides. That costs {cost:.2g} % of "
        f"the torque's rms, over {motion.words}; more where the motion hardly slides."
    )


def term_sentences(network: NortonNetwork, names: Sequence[str]) -> tuple[str, ...]:
    """One sentence for each of the network's terms that ``names`` has: what is lost, and what that costs."""
    lost = list(dict.fromkeys(term.name for term in network.terms if term.name in names))
    if not lost:
        return ()
    motion = standard_motion(network)
    costs = {name: cost_percent(network, without_terms(network, [name]), motion) for name in lost}
    return tuple(
        f"The term {name} is of the session that was fitted: what is written holds for the middle of it."
        if TERM_BY_NAME[name].in_time
        else f"The term {name} is left out ({_values(network, name)}): {network_term(network, name).term.meaning}. "
        f"That costs {costs[name]:.2g} % of the torque's rms, over {motion.words}."
        for name in lost
    )


def network_term(network: NortonNetwork, name: str) -> NetworkTerm:
    """The first term of that name."""
    return next(term for term in network.terms if term.name == name)


def _values(network: NortonNetwork, name: str) -> str:
    return "; ".join(term.text(network.command_unit) for term in network.terms if term.name == name)
