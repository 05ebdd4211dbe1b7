"""Nonlinear equivalent networks: two parts, joined linearly or not (paper, sections III and IV).

=========================  ================================  ==================================
type and form              linear connection                 nonlinear connection
=========================  ================================  ==================================
Norton, impedance          f = Z(x_N − x)                    f = Z(x_N, x), Z(x_N, x_N) = 0
Norton, admittance         x = x_N − Y(f)                    x = Y(x_N, f)
Thévenin, impedance        f = f_T − Z(x)                    f = Z(f_T, x)
Thévenin, admittance       x = Y(f_T − f), Fig. 1            x = Y(f_T, f)
=========================  ================================  ==================================

Source: ẇ = N_state(w, c), x_N = N_output(w, c). Connection: ż = Z_state(z, Δx, π), f = Z_output(z, Δx, π).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import Any

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.networks.expressions import Equations
from norton_bench.networks.kinds import Form, Kind, Load

MOTIONS = ("x", "v", "a")
EXERTIONS = ("f",)
DEVIATIONS = ("dx", "dv", "da")


@dataclass(frozen=True)
class NonlinearNetwork:
    """Names in the equations, by what they stand for:

    - ``x``, ``v``, ``a``: the port's angle [rad], velocity and acceleration; ``f``: its exertion [N m];
    - ``x_N``, ``v_N``, ``a_N`` and ``f_T``: what the source puts out, as much of it as the connection takes in;
    - ``dx``, ``dv``, ``da`` and ``df``: source less port, for a linear connection in these shapes: f = Z(x_N − x),
      x = Y(f_T − f); what the connection then puts out is the port's own ``f``, or ``x`` (and ``v``, ``a``);
    - ``f_Z`` and ``x_Y`` (``v_Y``, ``a_Y``): what the connection puts out in f = f_T − Z(x), x = x_N − Y(f);
    - any other input of either part is a command (c, π): ``command_units`` gives the unit of each.

    ``joined_linearly`` tells the columns of the table apart. ``step_s`` is the longest step of integration. ``domain``
    has, by name, the range in which the network holds. Raises ValueError, in a sentence, for equations that do not fit.
    """

    kind: Kind
    form: Form
    source: Equations
    connection: Equations
    command_units: Mapping[str, str]
    joined_linearly: bool = False
    step_s: float = 1e-3
    domain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 < self.step_s < 1e3:
            raise ValueError(f"step_s = {self.step_s} is not a step; give the longest step of integration in seconds")
        for name, (low, high) in self.domain.items():
            if not low < high:
                raise ValueError(f"domain of {name}: {low} is not below {high}")
        self._check_names()
        self._check_inputs()
        if self.first_output not in self.connection.outputs:
            raise ValueError(f'the connection must put out "{self.first_output}"')

    def _check_names(self) -> None:
        shared = sorted(set(self.source.rates) & set(self.connection.rates))
        if shared:
            raise ValueError(f'"{shared[0]}" is a state of both parts; give one of them another name')
        for name in (*self.command_units, *self.source.rates, *self.connection.rates):
            if not (name.isidentifier() and name.isascii()):
                raise ValueError(f'"{name}" is not a name; use letters, digits and _')
            if name in {*MOTIONS, *EXERTIONS, *self.source_out, *DEVIATIONS, "df"}:
                raise ValueError(f'"{name}" stands for a signal at the port or the source; rename the state or command')

    def _check_inputs(self) -> None:
        for name in self.source.inputs:
            if name not in self.command_units:
                raise ValueError(f'the source takes in "{name}", which is no command; add it to the commands')
        given = {*self.command_units, *self._given()}
        for name in self.connection.inputs:
            if name not in given:
                raise ValueError(f'the connection takes in "{name}"; here it can take in {", ".join(sorted(given))}')
        for far, deviation in self._deviations():
            if deviation in self.connection.inputs and far not in self.source.outputs:
                raise ValueError(f'the connection takes in "{deviation}", so the source must put out "{far}"')

    @property
    def deviates(self) -> bool:
        """Whether the connection takes in the difference of source and port (else it takes in the port alone)."""
        return self.joined_linearly and (self.kind is Kind.NORTON) == (self.form is Form.IMPEDANCE)

    @property
    def port_in(self) -> tuple[str, ...]:
        """What goes in at the port."""
        return MOTIONS if self.form is Form.IMPEDANCE else EXERTIONS

    @property
    def port_out(self) -> tuple[str, ...]:
        """What comes out there, as far as the equations say."""
        return EXERTIONS if self.form is Form.IMPEDANCE else MOTIONS

    @property
    def source_out(self) -> tuple[str, ...]:
        """Names of what the source may put out."""
        return ("f_T",) if self.kind is Kind.THEVENIN else ("x_N", "v_N", "a_N")

    @property
    def suffix(self) -> str:
        """What a linear connection's output is called where the source is beside it, not before it."""
        beside = self.joined_linearly and not self.deviates
        return "" if not beside else "_Z" if self.form is Form.IMPEDANCE else "_Y"

    @property
    def first_output(self) -> str:
        """The output that the connection must have."""
        return self.port_out[0] + self.suffix

    def _deviations(self) -> Iterator[tuple[str, str]]:
        """What the source calls a signal, and what its deviation at the port is called."""
        yield from zip(self.source_out, DEVIATIONS if self.kind is Kind.NORTON else ("df",), strict=True)

    def _given(self) -> Iterator[str]:
        if self.deviates:
            yield from (deviation for _, deviation in self._deviations())
            return
        yield from self.port_in
        if not self.joined_linearly:
            yield from self.source.outputs

    @property
    def start(self) -> dict[str, float]:
        """The states of both parts at the start."""
        return {**self.source.start, **self.connection.start}

    def source_values(self, states: Mapping[str, Any], commands: Mapping[str, Any]) -> dict[str, Any]:
        """What the source puts out (x_N, …, or f_T)."""
        return self.source.work_out({**states, **commands})

    def _connection_inputs(
        self, source: Mapping[str, Any], states: Mapping[str, Any], commands: Mapping[str, Any], port: Mapping[str, Any]
    ) -> dict[str, Any]:
        values = {**states, **commands, **port, **source}
        if self.deviates:
            pairs = zip(self._deviations(), self.port_in, strict=True)
            values |= {name: source[far] - port[near] for (far, name), near in pairs if far in source}
        return values

    def connect(
        self, source: Mapping[str, Any], states: Mapping[str, Any], commands: Mapping[str, Any], port: Mapping[str, Any]
    ) -> dict[str, Any]:
        """What comes out at the port (f; or x, and v and a where the equations say), from what goes in."""
        result = self.connection.work_out(self._connection_inputs(source, states, commands, port))
        if not self.suffix:
            return {name: result[name] for name in self.port_out if name in result}
        far = dict(zip(self.port_out, self.source_out, strict=True))
        return {
            name: source[far[name]] - result[name + self.suffix]
            for name in self.port_out
            if name + self.suffix in result and far[name] in source
        }

    def rates(self, states: Mapping[str, Any], commands: Mapping[str, Any], port: Mapping[str, Any]) -> dict[str, Any]:
        """Time derivatives of the states of both parts."""
        source = self.source_values(states, commands)
        return {
            **self.source.rates_of({**states, **commands}),
            **self.connection_rates(source, states, commands, port),
        }

    def connection_rates(
        self, source: Mapping[str, Any], states: Mapping[str, Any], commands: Mapping[str, Any], port: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Those of the connection alone, from what the source puts out."""
        if not self.connection.rates:
            return {}
        return self.connection.rates_of(self._connection_inputs(source, states, commands, port))

    def with_provenance(self, provenance: Mapping[str, str]) -> "NonlinearNetwork":
        """The same network, with more said of where it comes from."""
        return replace(self, provenance={**self.provenance, **provenance})


States = dict[str, Any]
Rates = Callable[[States, float], Mapping[str, Any]]

# A port's exertion that bends by more than this with acceleration is not that of an inertia.
BENT = 1e-6


# Nonlinear networks in time, by the classical Runge-Kutta method in steps no longer than the network's own.
#
# Commands are held from tick to tick; what goes in at the port is linear in between.
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
        result = network.connect(source, states, command, {"f": f})
        lacking = next((name for name, share in needs.items() if share and name not in result), None)
        if lacking:
            raise UsageError(f'the load must know "{lacking}" of the port; add it to what the connection puts out')
        return result

    def balance_at(f: Any) -> Any:
        result = motion(f)
        return f - sum(share * result[name] for name, share in needs.items() if share)

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
