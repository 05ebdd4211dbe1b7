"""Equations as people write them, "K*(x_N - x) + tau_c*tanh(v/v_0)": read, checked, worked out and put into C.

Names, numbers, + - * / **, the functions below, and "a if b > c else d". Nothing else is accepted, so that the
equations of a file from elsewhere can do no more than compute.
"""

import ast
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray

Values = Mapping[str, Any]
Worked = Callable[[Values], Any]


def _divided(a: Any, b: Any) -> Any:
    try:
        return a / b
    except ZeroDivisionError:  # a plain number; arrays give what is not finite by themselves
        return nan


def _lesser(a: Any, b: Any) -> Any:
    return np.minimum(a, b) if isinstance(a, np.ndarray) or isinstance(b, np.ndarray) else min(a, b)


def _greater(a: Any, b: Any) -> Any:
    return np.maximum(a, b) if isinstance(a, np.ndarray) or isinstance(b, np.ndarray) else max(a, b)


def _chosen(test: Any, yes: Callable[[], Any], no: Callable[[], Any]) -> Any:
    if isinstance(test, (bool, np.bool_)):
        return yes() if test else no()
    return np.where(test, yes(), no())


FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "sin": (1, np.sin),
    "cos": (1, np.cos),
    "tan": (1, np.tan),
    "asin": (1, np.arcsin),
    "acos": (1, np.arccos),
    "atan": (1, np.arctan),
    "atan2": (2, np.arctan2),
    "sinh": (1, np.sinh),
    "cosh": (1, np.cosh),
    "tanh": (1, np.tanh),
    "exp": (1, np.exp),
    "log": (1, np.log),
    "sqrt": (1, np.sqrt),
    "abs": (1, abs),
    "sign": (1, np.sign),
    "min": (2, _lesser),
    "max": (2, _greater),
}
_IN_C = {"abs": "fabs", "min": "fmin", "max": "fmax", "sign": "network_sign"}
CONSTANTS = {"pi": np.pi}
# Each operator in C, and the function that stands for it where Python's own will not do.
_BINARY: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any] | None]] = {
    ast.Add: ("+", None),
    ast.Sub: ("-", None),
    ast.Mult: ("*", None),
    ast.Div: ("/", _divided),
    ast.Pow: ("pow", np.float_power),
}
_COMPARISONS: dict[type[ast.cmpop], str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_VALUES, _NO_ARGUMENTS = "values", ast.arguments([], [], None, [], [], None, [])
LONGEST = 4000


@dataclass(frozen=True)
class Expression:
    """``text`` as written; ``work``: values by name to the result, numbers or arrays; ``c``: for C, with v_<name>."""

    text: str
    work: Worked
    c: str


def read_expression(text: str, names: Collection[str], tables: Mapping[str, Callable[..., Any]]) -> Expression:
    """Raises ValueError, in a sentence, for what is no expression, or holds a name that is none of ``names``.

    ``tables`` are functions of one or two arguments beside the built-in ones; in C they are named network_<name>.
    """
    if len(text) > LONGEST:
        raise ValueError(f'"{text[:20]}…" is longer than {LONGEST} characters; split it')
    try:
        reader = _Reader(text, frozenset(names), tables)
        rebuilt, c = reader.read(ast.parse(text.strip(), mode="eval").body)
        work = reader.compiled(rebuilt)
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(f'"{text}" is not an expression; write it like "K*(x_N - x) - B*v"') from None
    return Expression(text, work, c)


@dataclass(frozen=True)
class _Reader:
    """Rebuilds what was parsed from the few nodes that are allowed, as one function of Python and as C."""

    text: str
    names: frozenset[str]
    tables: Mapping[str, Callable[..., Any]]
    functions: dict[str, Callable[..., Any]] = field(default_factory=dict)  # that the rebuilt expression calls

    def compiled(self, rebuilt: ast.expr) -> Worked:
        arguments = ast.arguments([], [ast.arg(_VALUES)], None, [], [], None, [])
        whole = ast.fix_missing_locations(ast.Expression(ast.Lambda(arguments, rebuilt)))
        worked: Worked = eval(compile(whole, self.text, "eval"), {"__builtins__": {}, **self.functions})
        return worked

    def read(self, node: ast.AST) -> tuple[ast.expr, str]:
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return ast.Constant(_finite(value)), repr(_finite(value))
            case ast.Name(id=name):
                return self._name(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner, c = self.read(operand)
                return ast.UnaryOp(ast.USub(), inner), f"(-{c})"
            case ast.BinOp(op=operator) if type(operator) in _BINARY:
                return self._pair(node.left, operator, node.right)
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._call(name, args)
            case ast.IfExp(test=ast.Compare(left=left, ops=[op], comparators=[right])) if type(op) in _COMPARISONS:
                return self._choice(node, left, op, right)
        part = ast.get_source_segment(self.text.strip(), node) if hasattr(node, "lineno") else None
        raise ValueError(f'"{part or self.text}" in "{self.text}" cannot be worked out; use + - * / ** and functions')

    def _name(self, name: str) -> tuple[ast.expr, str]:
        if name in self.names:
            return ast.Subscript(ast.Name(_VALUES, ast.Load()), ast.Constant(name), ast.Load()), f"v_{name}"
        if name in CONSTANTS:
            return ast.Constant(CONSTANTS[name]), repr(float(CONSTANTS[name]))
        known = ", ".join(sorted(self.names))
        raise ValueError(f'"{name}" in "{self.text}" is not known; known are {known}')

    def _pair(self, left: ast.AST, operator: ast.operator, right: ast.AST) -> tuple[ast.expr, str]:
        (one, one_c), (other, other_c) = self.read(left), self.read(right)
        sign, function = _BINARY[type(operator)]
        c = f"pow({one_c}, {other_c})" if sign == "pow" else f"({one_c} {sign} {other_c})"
        return ast.BinOp(one, operator, other) if function is None else self._calling(function, one, other), c

    def _call(self, name: str, arguments: list[ast.expr]) -> tuple[ast.expr, str]:
        inner = [self.read(argument) for argument in arguments]
        joined = ", ".join(c for _, c in inner)
        if name in self.tables:
            function, in_c = self.tables[name], f"network_{name}"
        elif name in FUNCTIONS and FUNCTIONS[name][0] == len(arguments):
            function, in_c = FUNCTIONS[name][1], _IN_C.get(name, name)
        else:
            known = ", ".join([*FUNCTIONS, *self.tables])
            raise ValueError(f'"{name}" of {len(arguments)} in "{self.text}" is not a function known; known: {known}')
        return self._calling(function, *(each for each, _ in inner)), f"{in_c}({joined})"

    def _choice(self, node: ast.IfExp, left: ast.expr, op: ast.cmpop, right: ast.expr) -> tuple[ast.expr, str]:
        (low, low_c), (high, high_c) = self.read(left), self.read(right)
        (one, one_c), (other, other_c) = self.read(node.body), self.read(node.orelse)
        either = (ast.Lambda(_NO_ARGUMENTS, one), ast.Lambda(_NO_ARGUMENTS, other))
        decided = self._calling(_chosen, ast.Compare(low, [op], [high]), *either)
        return decided, f"(({low_c} {_COMPARISONS[type(op)]} {high_c}) ? {one_c} : {other_c})"

    def _calling(self, function: Callable[..., Any], *arguments: ast.expr) -> ast.expr:
        name = f"function_{len(self.functions)}"
        self.functions[name] = function
        return ast.Call(ast.Name(name, ast.Load()), list(arguments), [])


def _finite(value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = inf
    if not isfinite(number):
        raise ValueError("a number is too great to compute with; check its exponent")
    return number


# A part of a network as equations in state form: ẇ = N_state(w, c), x_N = N_output(w, c) and the like (section IV).
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
        result = {}
        for name, text in texts.items():
            try:
                result[name] = read_expression(text, names, self.tables)
            except ValueError as error:
                raise ValueError(f"{what} {name}: {error}") from None
        return result

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
