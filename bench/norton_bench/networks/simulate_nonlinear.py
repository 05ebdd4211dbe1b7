"""Nonlinear networks in time, by the classical Runge-Kutta method in steps no longer than the network's own.

Commands are held from tick to tick; what goes in at the port is linear in between.
"""

from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any

import numpy as np

from norton_bench.errors import UsageError
from norton_bench.networks.kinds import Form
from norton_bench.networks.motion import Load
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import FloatArray

States = dict[str, Any]
Rates = Callable[[States, float], Mapping[str, Any]]

# A port's exertion that bends by more than this with acceleration is not that of an inertia.
BENT = 1e-6


def respond(
    network: NonlinearNetwork, commands: FloatArray, port: Mapping[str, FloatArray], tick_s: float
) -> dict[str, FloatArray]:
    """What comes out at the port at the ticks, by name, each (n,), from the states at the start.

    ``commands`` is (n, m) in the order of ``command_units``; ``port`` has what goes in, by name, each (n,).
    """
    names = tuple(network.command_units)
    port = {name: port[name] for name in network.port_in}
    substeps = steps_in(tick_s, network.step_s)
    states: States = dict(network.start)
    rows = []
    with np.errstate(all="ignore"):
        for k, held in enumerate(commands):
            command = dict(zip(names, held.tolist(), strict=True))
            here = {name: float(signal[k]) for name, signal in port.items()}
            after = {name: float(signal[min(k + 1, len(commands) - 1)]) for name, signal in port.items()}
            rows.append(network.connect(network.source_values(states, command), states, command, here))

            def rates(at: States, part: float, command: Any = command, here: Any = here, after: Any = after) -> Any:
                between = {name: here[name] + part * (after[name] - here[name]) for name in here}
                return network.rates(at, command, between)

            states = advance(states, rates, tick_s, substeps)
    return _columns(rows)


def coupled(network: NonlinearNetwork, commands: FloatArray, load: Load, tick_s: float) -> dict[str, FloatArray]:
    """Port angle ``x`` and exertion ``f`` at the ticks, each (n,), with the load on it.

    An impedance form starts at the source's own place, at rest, an admittance form from its states. Raises UsageError,
    in a sentence, where no motion follows: no inertia together, or a form that does not say what the load must know.
    """
    names = tuple(network.command_units)
    substeps = steps_in(tick_s, network.step_s)
    states: States = dict(network.start)
    port = _carried if network.form is Form.IMPEDANCE else _pushed
    if network.form is Form.IMPEDANCE:
        first = dict(zip(names, commands[0].tolist(), strict=True))
        states |= {"x": float(network.source_values(states, first).get("x_N", 0.0)), "v": 0.0}
    rows = []
    with np.errstate(all="ignore"):
        for held in commands:
            command = dict(zip(names, held.tolist(), strict=True))
            here = port(network, states, command, load)
            rows.append({"x": here["x"], "f": here["f"]})

            def rates(at: States, _: float, command: Any = command) -> Any:
                now = port(network, at, command, load)
                moved = {"x": now["v"], "v": now["a"]} if "v" in at else {}
                return {**network.rates(at, command, now), **moved}

            states = advance(states, rates, tick_s, substeps)
    return _columns(rows)


def _carried(network: NonlinearNetwork, states: States, command: Mapping[str, Any], load: Load) -> dict[str, Any]:
    acceleration, exertion = balance(network, states, command, load)
    return {"x": states["x"], "v": states["v"], "a": acceleration, "f": exertion}


def _pushed(network: NonlinearNetwork, states: States, command: Mapping[str, Any], load: Load) -> dict[str, Any]:
    """The exertion at which an admittance and the load agree, and the motion that it gives."""
    source = network.source_values(states, command)
    needs = {"x": load.stiffness_nm_rad, "v": load.damping_nms_rad, "a": load.inertia_kgm2}

    def motion(f: Any) -> dict[str, Any]:
        found = network.connect(source, states, command, {"f": f})
        lacking = next((name for name, share in needs.items() if share and name not in found), None)
        if lacking:
            raise UsageError(f'the load must know "{lacking}" of the port; add it to what the connection puts out')
        return found

    def balance_at(f: Any) -> Any:
        found = motion(f)
        return f - sum(share * found[name] for name, share in needs.items() if share)

    none, some, more = (balance_at(f) for f in (0.0, 1.0, 2.0))
    if np.any(np.abs(more - 2.0 * some + none) > BENT * (np.abs(some - none) + 1.0) + 1e-12 * np.abs(none)):
        raise UsageError("the network's motion is not linear in exertion, so no load can be put on it here")
    exertion = none / (none - some)
    return {**motion(exertion), "f": exertion}


def balance(
    network: NonlinearNetwork, states: Mapping[str, Any], command: Mapping[str, Any], load: Load
) -> tuple[Any, Any]:
    """Acceleration [rad/s²] and exertion [N m] at which network and load agree: I a + B v + K x = f(…, a)."""
    source = network.source_values(states, command)
    still, pushed, further = (
        network.connect(source, states, command, {"x": states["x"], "v": states["v"], "a": a})["f"]
        for a in (0.0, 1.0, 2.0)
    )
    own = still - pushed
    if np.any(
        np.abs(pushed - further - own) > BENT * (np.abs(own) + np.abs(load.inertia_kgm2)) + 1e-12 * np.abs(still)
    ):
        raise UsageError("the network's exertion is not linear in acceleration; couple it to a load elsewhere")
    total = load.inertia_kgm2 + own
    if np.any(total <= 0.0):
        raise UsageError("load and network have no inertia together, so no acceleration follows; give the load some")
    a = (still - load.damping_nms_rad * states["v"] - load.stiffness_nm_rad * states["x"]) / total
    return a, still - own * a


def advance(states: States, rates: Rates, tick_s: float, substeps: int) -> States:
    """The states a tick later. ``rates`` are told the part of the tick that is over."""
    step_s = tick_s / substeps
    for index in range(substeps):
        begin, end = index / substeps, (index + 1) / substeps
        middle = 0.5 * (begin + end)
        one = rates(states, begin)
        two = rates(_moved(states, one, 0.5 * step_s), middle)
        three = rates(_moved(states, two, 0.5 * step_s), middle)
        four = rates(_moved(states, three, step_s), end)
        states = {
            name: value + step_s / 6.0 * (one[name] + 2.0 * two[name] + 2.0 * three[name] + four[name])
            for name, value in states.items()
        }
    return states


def steps_in(tick_s: float, longest_s: float) -> int:
    """How many equal steps, none longer than ``longest_s``, make up a tick."""
    return max(1, ceil(tick_s / longest_s - 1e-9))


def _moved(states: States, rates: Mapping[str, Any], step_s: float) -> States:
    return {name: value + step_s * rates[name] for name, value in states.items()}


def _columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, FloatArray]:
    columns = {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}
    if not all(np.isfinite(column).all() for column in columns.values()):
        raise UsageError(
            "the equations do not stay finite; check that the motion lies in the network's domain and that step_s is "
            "short enough for its fastest state"
        )
    return columns
