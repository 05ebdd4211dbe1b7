"""Whether a network can be told from its port without ambiguity: the paper's three conditions (IV.B.1, VI.C)."""

from collections.abc import Iterator

import numpy as np

from norton_bench.models.network import NortonNetwork
from norton_bench.models.servo_source import SETTLED, settling_in_words, still_to_come, zero_in_words
from norton_bench.models.sliding import command_shown, falling, greatest_friction_nm, steepness_nms_rad
from norton_bench.models.terms import TERM_BY_NAME, waves_of
from norton_bench.networks.equation_checks import conditions_of_equations
from norton_bench.networks.family import Network
from norton_bench.networks.findings import Finding, of_modes
from norton_bench.networks.kinds import Kind, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import stable
from norton_bench.networks.settled import SETTLE_S


def check(network: Network, *, settle_s: float = SETTLE_S) -> tuple[Finding, ...]:
    """Impedance form, a source that is the connection's zero, a unique zero, stable zero dynamics.

    ``settle_s`` is how long a nonlinear network with states is given to come to rest.
    """
    match network:
        case LinearNetwork():
            return tuple(_linear(network))
        case NonlinearNetwork():
            return tuple(conditions_of_equations(network, settle_s))
    return tuple(_motor(network))


def _motor(network: NortonNetwork) -> Iterator[Finding]:
    load = next((term.values[0] for term in network.terms if term.name == "load"), 0.0)
    yield Finding(
        "impedance form",
        load < 1.0,
        "every motion has its torque: friction, damping and inertia follow from it"
        if load < 1.0
        else f"friction grows by μ = {load:.3g} of the torque at the port: from 1 on, not every motion has one torque",
    )
    yield Finding("source is a zero", True, "the free motion is where the torque vanishes, contact's history included")
    if network.holds_position:
        yield from _held(network)
        return
    yield from _sliding(network)
    held = f"{greatest_friction_nm(network):.4g}"
    most = f"{held} N m of friction and cogging" if network.terms else f"τc = {held} N m"
    yield Finding(
        "exertion source",
        False,
        f"a blocked port exerts its motor torque within ± {most}, by how it came to "
        "rest: only the motion source can be told from the port",
    )


def _held(network: NortonNetwork) -> Iterator[Finding]:
    """The shaft of a servo that holds a position goes to its goal, and settles there."""
    yield Finding("unique zero", network.torque_gain > 0.0, zero_in_words(network))
    yield _settles(network)
    yield Finding(
        "exertion source",
        None,
        f"a blocked port exerts {network.torque_gain:.4g} N m/rad of its distance from the goal"
        + ("" if network.torque_limit_nm is None else f", {network.torque_limit_nm:.4g} N m at most")
        + f", within ± τc = {network.coulomb_torque_nm:.4g} N m by how it came to rest",
    )


def _sliding(network: NortonNetwork) -> Iterator[Finding]:
    """Whether one free velocity belongs to each command, and whether the free rotor keeps to it."""
    if network.joint is not None and network.joint[3]:
        width = 2 * network.joint[3]
        yield Finding(
            "unique zero", False, f"within the play of {width:.3g} rad the port is without torque anywhere", width
        )
        return
    fastest = np.abs(network.source_velocity(command_shown(network) * np.array([-1.0, 1.0]))).max()
    falls, steepness = falling(network, float(fastest)), steepness_nms_rad(network)
    by = "B" if network.servo is None else "B and the loop's gain"
    places = _places(network)
    if falls is None:
        yield Finding(
            "unique zero",
            steepness > 0.0,
            f"sliding torque falls with velocity by {by} = {steepness:.4g} N m s/rad, so each "
            f"command has one free velocity{places}",
        )
        yield _settles(network)
        return
    low, high, slope = falls
    yield Finding(
        "unique zero",
        False,
        f"friction falls with the speed from {low:.3g} to {high:.3g} rad/s, by up to {-slope:.3g} N m s/rad, so a "
        "command near the threshold has two free velocities, of which rest is one; the source is that of a shaft that "
        f"was at rest{places}",
    )
    yield Finding(
        "stable zero dynamics",
        False,
        f"free sliding from {low:.3g} to {high:.3g} rad/s is unstable, for friction falls with the speed there: the "
        "shaft stops, or speeds up until friction rises",
    )


def _settles(network: NortonNetwork) -> Finding:
    """A motor at last; a servo's loop is late, and may give energy."""
    if network.servo is None:
        return Finding(
            "stable zero dynamics", True, "inertia, damping and friction only take energy from the free rotor"
        )
    left = still_to_come(network)
    return Finding("stable zero dynamics", left <= SETTLED, settling_in_words(left))


def _places(network: NortonNetwork) -> str:
    """What the position does to the source, as a part of a sentence."""
    names = [name for name in dict.fromkeys(term.name for term in network.terms) if TERM_BY_NAME[name].periodic]
    if not names:
        return ""
    waves = float(np.sum(np.hypot(*waves_of(network.terms)[:, 1:].T)))
    rests = f"; cogging of up to {waves:.3g} N m draws a shaft at rest to some places" if waves else ""
    return f", at its mean over a turn ({', '.join(names)}){rests}"


def _linear(network: LinearNetwork) -> Iterator[Finding]:
    try:
        impedance = network.impedance
    except NoConversionError as error:
        yield Finding("impedance form", False, str(error))
        return
    behind = impedance.derivatives
    yield Finding("impedance form", True, f"exertion follows the motion and {behind} of its derivatives")
    if network.kind is Kind.NORTON:
        yield Finding("source is a zero", True, "the connection is linear: no deviation, no exertion")
    elif stable(network.admittance.poles()):
        yield Finding("source is a zero", True, "the equivalent motion source exists: f_T through the admittance")
    else:
        yield Finding("source is a zero", False, "the free port runs away, so no motion source exists")
    if impedance.vanishes:
        yield Finding("unique zero", False, "the impedance is zero: no exertion at any motion")
        return
    zeros = impedance.zeros()
    slow = np.abs(zeros) <= 1e-9 * np.abs(zeros).max(initial=0.0)
    what = "velocity: a place alone gives no exertion" if zeros.size and slow.any() else "place"
    yield Finding("unique zero", True, f"without exertion, the settled port has one {what}")
    holds, why = of_modes(zeros)
    at_zero = int(np.count_nonzero(slow))
    if holds is None:  # linear: nothing but its modes decides
        holds = at_zero == 1
        why += "; the place of the free port is free, its velocity settles" if holds else "; the free port drifts away"
    yield Finding("stable zero dynamics", holds, f"zeros of the impedance: {why}")
