"""Networks at rest: what the source gives, what the port exerts, and the impedance around a place, numerically."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.family import Network, commands_of, kind_of
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork, advance, steps_in
from norton_bench.networks.operator import Operator, driven
from norton_drivers.servo import Servo

SETTLE_S = 1.0
# Relative step of the differences that linearise.
NUDGE = 1e-6
# A source that still moves by this part of its range in a tenth of the settling time is a velocity.
MOVES_ON = 1e-3


@dataclass(frozen=True)
class StaticSource:
    """What the settled source gives for each command, shape (n,): ``quantity`` is x_N, v_N or f_T, in ``unit``."""

    command: FloatArray
    value: FloatArray
    quantity: str
    unit: str


def static_source(
    network: Network, command: npt.ArrayLike, *, name: str | None = None, settle_s: float = SETTLE_S
) -> StaticSource:
    """The source against the command ``name`` (the first, where none is named), the others as :func:`middle` has them.

    A motion source that settles at a velocity is given as such. Raises UsageError where it does not settle.
    """
    levels = np.atleast_1d(np.asarray(command, dtype=float))
    names = tuple(commands_of(network))
    if not names:
        raise UsageError("the network has no command, so there is no source to show; it is an element")
    varied = name or names[0]
    if varied not in names:
        raise UsageError(f'the network has no command "{varied}"; it has {", ".join(names)}')
    match network:
        case NortonNetwork(servo=Servo(holds_position=True)):
            return StaticSource(levels, levels, "x_N", "rad")
        case NortonNetwork():
            return StaticSource(levels, network.source_velocity(levels), "v_N", "rad/s")
        case LinearNetwork():
            return _linear_source(network, levels, names.index(varied))
    commands = {name: np.full_like(levels, value) for name, value in middle(network).items()} | {varied: levels}
    states = settled(network, commands, 0.9 * settle_s)
    before = network.source_values(states, commands)
    after = network.source_values(settled(network, commands, 0.1 * settle_s, start=states), commands)
    quantity = network.source_out[0]
    value = np.broadcast_to(np.asarray(after[quantity], dtype=float), levels.shape)
    moved = value - before[quantity]
    if kind_of(network) is Kind.NORTON and np.any(np.abs(moved) > MOVES_ON * (np.ptp(value) + 1e-12)):
        return StaticSource(levels, moved / (0.1 * settle_s), "v_N", "rad/s")
    return StaticSource(levels, value, quantity, "rad" if quantity == "x_N" else "N m")


def middle(network: NonlinearNetwork) -> dict[str, float]:
    """Every command in the middle of its domain, or at zero where none is declared."""
    return {name: float(np.mean(network.domain.get(name, (0.0, 0.0)))) for name in network.command_units}


def _linear_source(network: LinearNetwork, levels: FloatArray, place: int) -> StaticSource:
    norton = network.kind is Kind.NORTON
    shapes = [(network.source, "x_N" if norton else "f_T", "rad" if norton else "N m")]
    if norton:
        shapes.append((network.source.differentiated().minimal(), "v_N", "rad/s"))
    for operator, quantity, unit in shapes:
        try:
            gain = operator.response(0.0)[0, place].real
        except np.linalg.LinAlgError:
            continue
        if np.isfinite(gain):
            return StaticSource(levels, gain * levels, quantity, unit)
    raise UsageError("the source does not settle under a constant command: it has more than one integrator in it")


def settled(
    network: NonlinearNetwork,
    commands: Mapping[str, Any],
    settle_s: float = SETTLE_S,
    port: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The states after ``settle_s`` under constant commands, with the port held at ``port`` or following the source.

    Numbers, or arrays of one shape. Without a port to hold: no exertion, or an impedance's port at the source (at zero
    for an exertion source).
    """
    states: dict[str, Any] = dict(network.start if start is None else start)
    if not states:
        return {}
    shape = np.broadcast_shapes(*(np.shape(value) for value in [*commands.values(), *(port or {}).values()]))
    states = {name: np.full(shape, value) for name, value in states.items()}

    def rates(at: dict[str, Any], _: float) -> Mapping[str, Any]:
        held = port if port is not None else at_source(network, at, commands)
        return network.rates(at, commands, held)

    substeps = steps_in(settle_s, network.step_s)
    with np.errstate(all="ignore"):
        result = advance(states, rates, settle_s, substeps)
    if not all(np.isfinite(value).all() for value in result.values()):
        raise UsageError(
            "the states do not stay finite; is step_s short enough, and do the commands lie in the domain?"
        )
    return result


def at_source(network: NonlinearNetwork, states: Mapping[str, Any], commands: Mapping[str, Any]) -> dict[str, Any]:
    """The port's input while nothing is exchanged there: the source's motion, no motion, or no exertion."""
    if network.form is Form.ADMITTANCE:
        return {"f": 0.0} if network.kind is Kind.NORTON else {"f": network.source_values(states, commands)["f_T"]}
    source = network.source_values(states, commands)
    return {near: source.get(far, 0.0) for near, far in (("x", "x_N"), ("v", "v_N"), ("a", "a_N"))}


def static_exertion(
    network: NonlinearNetwork, commands: Mapping[str, Any], position_rad: npt.ArrayLike, settle_s: float = SETTLE_S
) -> FloatArray:
    """f [N m] of an impedance form with the port held at ``position_rad``; commands are numbers or of its shape."""
    position = np.asarray(position_rad, dtype=float)
    port: dict[str, Any] = {"x": position, "v": 0.0, "a": 0.0}
    states = settled(network, commands, settle_s, port)
    source = network.source_values(states, commands)
    result = network.connect(source, states, commands, port)["f"]
    return np.broadcast_to(np.asarray(result, dtype=float), position.shape)


def linearised(network: NonlinearNetwork, commands: Mapping[str, float], *, settle_s: float = SETTLE_S) -> Operator:
    """Small motions around the settled network: Z = −∂f/∂x for an impedance form, Y = −∂x/∂f for an admittance form.

    The source stands still meanwhile. Commands are numbers, by name.
    """
    base = {name: float(value) for name, value in settled(network, commands, settle_s).items()}
    with np.errstate(all="ignore"):
        port = {name: float(value) for name, value in at_source(network, base, commands).items()}
        source = network.source_values(base, commands)
    own, inputs = tuple(network.connection.rates), tuple(port)
    out = network.port_out[0]

    def work(values: Mapping[str, float]) -> FloatArray:
        states = {**base, **{name: values[name] for name in own}}
        at_port = {name: values[name] for name in inputs}
        connected = network.connect(source, states, commands, at_port)[out]
        rates = network.connection_rates(source, states, commands, at_port)
        return np.array([*(rates[name] for name in own), connected], dtype=float)

    centre = {**{name: base[name] for name in own}, **port}
    with np.errstate(all="ignore"):
        slopes = {name: _slope(work, centre, name) for name in centre}
    if not all(np.isfinite(slope).all() for slope in slopes.values()):
        raise UsageError("the equations are not finite around the settled source; check the domain of the commands")
    n = len(own)
    state = np.array([slopes[name][:n] for name in own]).reshape(n, n).T
    exit_row = np.array([slopes[name][n] for name in own])
    entries = [slopes[name][:n, None] for name in inputs]
    direct = np.array([[slopes[name][n]] for name in inputs])
    return -(driven(state, entries, exit_row) + Operator.of([], [], [], direct))


def _slope(work: Any, centre: Mapping[str, float], name: str) -> FloatArray:
    step = NUDGE * max(1.0, abs(centre[name]))
    above, below = ({**centre, name: centre[name] + side * step} for side in (1.0, -1.0))
    return np.asarray((work(above) - work(below)) / (2.0 * step))
