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

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from norton_bench.networks.equations import Equations
from norton_bench.networks.kinds import Form, Kind

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
        found = self.connection.work_out(self._connection_inputs(source, states, commands, port))
        if not self.suffix:
            return {name: found[name] for name in self.port_out if name in found}
        far = dict(zip(self.port_out, self.source_out, strict=True))
        return {
            name: source[far[name]] - found[name + self.suffix]
            for name in self.port_out
            if name + self.suffix in found and far[name] in source
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
