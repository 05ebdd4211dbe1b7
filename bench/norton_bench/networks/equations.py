"""A part of a network as equations in state form: ẇ = N_state(w, c), x_N = N_output(w, c) and the like (section IV)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.networks.expressions import CONSTANTS, FUNCTIONS, Expression, read_expression


@dataclass(frozen=True)
class Table:
    """Measured maps as functions of one or two arguments: linear between the nodes, constant beyond them.

    ``nodes``: one or two rising grids; ``values``: as many, or a row for each node of the first grid.

    Raises ValueError, in a sentence, for grids that do not rise or values that do not fit them.
    """

    nodes: tuple[tuple[float, ...], ...]
    values: tuple[float, ...] | tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        shape = tuple(len(grid) for grid in self.nodes)
        if len(shape) not in {1, 2} or min(shape, default=0) < 2:
            raise ValueError("a table needs one or two grids of at least two nodes each")
        if not all(np.all(np.diff(grid) > 0.0) for grid in self.nodes):
            raise ValueError("the nodes of a table must rise; sort them and leave out what is there twice")
        try:
            fits = np.shape(np.asarray(self.values, dtype=float)) == shape
        except ValueError:
            fits = False
        if not fits or not np.isfinite(np.asarray(self.values, dtype=float)).all():
            raise ValueError(f"the values of a table must be finite numbers, {' by '.join(map(str, shape))} of them")

    def __call__(self, *arguments: npt.ArrayLike) -> FloatArray:
        """The value at one or two arguments, numbers or arrays of one shape."""
        if len(self.nodes) == 1:
            return np.asarray(np.interp(np.asarray(arguments[0], dtype=float), self.nodes[0], np.asarray(self.values)))
        values = np.asarray(self.values)
        (i, p), (j, q) = (_place(np.asarray(grid), each) for grid, each in zip(self.nodes, arguments, strict=True))
        low = (1 - q) * values[i, j] + q * values[i, j + 1]
        high = (1 - q) * values[i + 1, j] + q * values[i + 1, j + 1]
        return np.asarray((1 - p) * low + p * high)


def _place(grid: FloatArray, argument: npt.ArrayLike) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """The node below, and the part of the way to the next."""
    held = np.clip(np.asarray(argument, dtype=float), grid[0], grid[-1])
    below = np.clip(np.searchsorted(grid, held, side="right") - 1, 0, grid.size - 2)
    return below, (held - grid[below]) / (grid[below + 1] - grid[below])


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
