"""Whether a network can be told from its port without ambiguity: the paper's three conditions (IV.B.1, VI.C)."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.drawn_motor import command_shown, falling, greatest_friction_nm
from norton_bench.models.network import NortonNetwork
from norton_bench.models.servo_source import SETTLED, settling_in_words, still_to_come, zero_in_words
from norton_bench.models.terms import TERM_BY_NAME, waves_of
from norton_bench.networks.family import Network, form_of, kind_of
from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import stable
from norton_bench.networks.settled import SETTLE_S, linearised, settled

PLACES = 21
POINTS = 401
# An exertion below this part of the greatest in the domain is none.
NOTHING = 1e-9
# What is said of a condition.
VERDICTS = {True: "holds", False: "does not hold", None: "cannot be told"}


@dataclass(frozen=True)
class Finding:
    """A condition, whether it holds (None: cannot be told), and why, in a sentence.

    ``interval_rad`` is the widest range of displacement without exertion that was found, where the zero is not unique.
    """

    condition: str
    holds: bool | None
    why: str
    interval_rad: float | None = None


def check(network: Network, *, settle_s: float = SETTLE_S) -> tuple[Finding, ...]:
    """Impedance form, a source that is the connection's zero, a unique zero, stable zero dynamics.

    ``settle_s`` is how long a nonlinear network with states is given to come to rest.
    """
    match network:
        case LinearNetwork():
            return tuple(_linear(network))
        case NonlinearNetwork():
            return tuple(_nonlinear(network, settle_s))
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
    if network.servo is not None:
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
    """A servo's shaft goes to its goal, and settles there."""
    left = still_to_come(network)
    yield Finding("unique zero", network.torque_gain > 0.0, zero_in_words(network))
    yield Finding("stable zero dynamics", left <= SETTLED, settling_in_words(left))
    yield Finding(
        "exertion source",
        None,
        f"a blocked port exerts {network.torque_gain:.4g} N m/rad of its distance from the goal"
        + ("" if network.torque_limit_nm is None else f", {network.torque_limit_nm:.4g} N m at most")
        + f", within ± τc = {network.coulomb_torque_nm:.4g} N m by how it came to rest",
    )


def _sliding(network: NortonNetwork) -> Iterator[Finding]:
    """Whether one free velocity belongs to each command, and whether the free rotor keeps to it."""
    fastest = np.abs(network.source_velocity(command_shown(network) * np.array([-1.0, 1.0]))).max()
    falls = falling(network, float(fastest))
    places = _places(network)
    if falls is None:
        yield Finding(
            "unique zero",
            network.viscous_damping_nms_rad > 0.0,
            f"sliding torque falls with velocity by B = {network.viscous_damping_nms_rad:.4g} N m s/rad, so each "
            f"command has one free velocity{places}",
        )
        yield Finding(
            "stable zero dynamics", True, "inertia, damping and friction only take energy from the free rotor"
        )
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
    worst = float(zeros.real.max(initial=-np.inf))
    slowest = "there are none" if not zeros.size else f"the slowest lies at {worst:.4g} rad/s"
    yield Finding("stable zero dynamics", stable(zeros), f"zeros of the impedance: {slowest}")


def _nonlinear(network: NonlinearNetwork, settle_s: float) -> Iterator[Finding]:
    if form_of(network) is not Form.IMPEDANCE:
        yield Finding(
            "impedance form", False, "an admittance form: an impedance form of it need not exist (section III)"
        )
        return
    yield Finding("impedance form", True, "the equations put out f for every motion")
    if kind_of(network) is not Kind.NORTON:
        yield Finding("source is a zero", False, "an exertion source is no zero of the impedance (section VI.C)")
        return
    try:
        yield from _zero(network, settle_s)
        zeros = np.concatenate([linearised(network, each, settle_s=settle_s).zeros() for each in _commands(network)])
        worst = float(zeros.real.max(initial=-np.inf))
        why = "no dynamics" if not zeros.size else f"the slowest mode of the free port lies at {worst:.4g} rad/s"
        yield Finding("stable zero dynamics", stable(zeros), f"linearised at the settled source: {why}")
    except (UsageError, ZeroDivisionError) as error:
        yield Finding("stable zero dynamics", None, f"the network could not be linearised: {error}")


def _zero(network: NonlinearNetwork, settle_s: float) -> Iterator[Finding]:
    """Z(x_N, x_N) = 0, and how many zeros there are beside it, over the declared domain."""
    motion = "x" if {"x", "dx"} & set(network.connection.inputs) else "v"
    if motion not in network.domain:
        text = f'declare the domain of "{motion}", then this can be checked'
        yield Finding("source is a zero", None, text)
        yield Finding("unique zero", None, text)
        return
    at_source, widest, crossings = 0.0, 0.0, 1
    for commands in _commands(network):
        source, exertion = _exertions(network, commands, motion, settle_s)
        size = float(np.abs(exertion).max()) or 1.0
        places = np.linspace(*network.domain[motion], POINTS)
        at_source = max(at_source, float(np.abs(np.diagonal(exertion[:, _nearest(places, source)])).max()) / size)
        flat, zeros = _zeros(places, exertion, NOTHING * size)
        widest, crossings = max(widest, flat), max(crossings, zeros)
    holds = at_source <= 1e-9
    how = f"at x = x_N the exertion is at most {at_source:.2g} of the greatest in the domain"
    yield Finding("source is a zero", holds, how)
    if widest > 0.0:
        unit = "rad" if motion == "x" else "rad/s"
        text = f"no exertion over a range of {widest:.4g} {unit}: the source is known to within that"
        yield Finding("unique zero", False, text, widest)
        return
    number = "once" if crossings == 1 else f"{crossings} times"
    yield Finding(
        "unique zero", crossings == 1, f"over the domain of {motion} the exertion is zero {number} at the most"
    )


def _nearest(places: FloatArray, wanted: FloatArray) -> Any:
    return np.abs(places[None, :] - wanted[:, None]).argmin(axis=1)


def _exertions(
    network: NonlinearNetwork, commands: dict[str, float], motion: str, settle_s: float
) -> tuple[FloatArray, FloatArray]:
    """Source places (p,) on the grid of the domain, and exertion (p, POINTS) with the port anywhere else.

    The connection is asked, not the source: the identity must hold for any x_N, also those that no command reaches.
    """
    places = np.linspace(*network.domain[motion], POINTS)
    low, high = network.domain.get(f"{motion}_N", network.domain[motion])
    chosen = places[(places >= low) & (places <= high)]
    chosen = chosen[:: max(1, len(chosen) // PLACES)]
    source = dict.fromkeys(network.source.outputs, 0.0) | {f"{motion}_N": chosen[:, None]}
    port = {"x": 0.0, "v": 0.0, "a": 0.0} | {motion: places[None, :]}
    states = settled(network, commands, settle_s) if network.connection.rates else dict(network.start)
    exertion = network.connect(source, states, commands, port)["f"]
    return chosen, np.broadcast_to(np.asarray(exertion, dtype=float), (chosen.size, places.size))


def _zeros(places: FloatArray, exertion: FloatArray, nothing: float) -> tuple[float, int]:
    """The widest flat stretch of no exertion (0.0 where there is none), and the most zeros in one row."""
    widest, most = 0.0, 1
    for row in exertion:
        none = np.abs(row) <= nothing
        edges = np.flatnonzero(np.diff(np.concatenate([[False], none, [False]]).astype(int)))
        starts, ends = edges[::2], edges[1::2] - 1
        widest = max(widest, float((places[ends] - places[starts]).max(initial=0.0)))
        signs = np.sign(np.where(none, 0.0, row))
        most = max(most, len(starts) + int(np.sum(signs[:-1] * signs[1:] < 0)))
    return widest, most


def _commands(network: NonlinearNetwork) -> Iterator[dict[str, float]]:
    """Both ends and the middle of each command's domain, in every combination; zero where it has none."""
    ranges = [
        np.linspace(*network.domain[name], 3) if name in network.domain else np.zeros(1)
        for name in network.command_units
    ]
    for values in product(*ranges):
        yield dict(zip(network.command_units, map(float, values), strict=True))
