"""A part of a network as equations in state form: ẇ = N_state(w, c), x_N = N_output(w, c) and the like (section IV)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from norton_bench.networks.expressions import CONSTANTS, FUNCTIONS, Expression, read_expression
from norton_bench.networks.tables import Table


@dataclass(frozen=True)
class Equations:
    """``outputs`` and ``rates`` (of the states) are expressions by name over inputs, states and parameters.

    ``initial`` has the states' values at the start, zero where it has none. ``tables`` are functions that the
    expressions may call. Raises ValueError, in a sentence with the place, for equations that cannot be worked out.
    """

    inputs: tuple[str, ...]
    outputs: Mapping[str, str]
    rates: Mapping[str, str] = field(default_factory=dict)
    initial: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    read_outputs: Mapping[str, Expression] = field(init=False, repr=False, compare=False)
    read_rates: Mapping[str, Expression] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        names = [*self.inputs, *self.rates, *self.parameters]
        for name in [*names, *self.outputs, *self.tables]:
            if not (name.isidentifier() and name.isascii()):
                raise ValueError(f'"{name}" is not a name; use letters, digits and _')
        taken = set(FUNCTIONS) | set(CONSTANTS) | set(self.tables)
        twice = sorted({name for name in names if names.count(name) > 1} | (taken & set(names)))
        if twice:
            raise ValueError(f'"{twice[0]}" stands for two things; give one of them another name')
        stray = sorted(set(self.initial) - set(self.rates))
        if stray:
            raise ValueError(f'initial value of "{stray[0]}": there is no state of that name')
        for name, value in (*self.initial.items(), *self.parameters.items()):
            if not isfinite(value):
                raise ValueError(f'"{name}" is {value}; give it a finite value')
        object.__setattr__(self, "read_outputs", self._read("output", self.outputs, names))
        object.__setattr__(self, "read_rates", self._read("rate of", self.rates, names))

    def _read(self, what: str, texts: Mapping[str, str], names: list[str]) -> dict[str, Expression]:
        found = {}
        for name, text in texts.items():
            try:
                found[name] = read_expression(text, names, self.tables)
            except ValueError as error:
                raise ValueError(f"{what} {name}: {error}") from None
        return found

    @property
    def start(self) -> dict[str, float]:
        """The states at the start, by name."""
        return {name: float(self.initial.get(name, 0.0)) for name in self.rates}

    def work_out(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The outputs, from inputs and states by name (numbers, or arrays of one shape)."""
        known = {**self.parameters, **values}
        return {name: expression.work(known) for name, expression in self.read_outputs.items()}

    def rates_of(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The states' time derivatives, likewise."""
        known = {**self.parameters, **values}
        return {name: expression.work(known) for name, expression in self.read_rates.items()}
