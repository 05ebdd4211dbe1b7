"""Equations as people write them, "K*(x_N - x) + tau_c*tanh(v/v_0)": read, checked, worked out and put into C.

Names, numbers, + - * / **, the functions below, and "a if b > c else d". Nothing else is accepted, so that the
equations of a file from elsewhere can do no more than compute.
"""

import ast
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Any

import numpy as np

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
_BINARY: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", lambda a, b: a + b),
    ast.Sub: ("-", lambda a, b: a - b),
    ast.Mult: ("*", lambda a, b: a * b),
    ast.Div: ("/", _divided),
    ast.Pow: ("pow", np.float_power),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Lt: ("<", lambda a, b: a < b),
    ast.LtE: ("<=", lambda a, b: a <= b),
    ast.Gt: (">", lambda a, b: a > b),
    ast.GtE: (">=", lambda a, b: a >= b),
}
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
        tree = ast.parse(text.strip(), mode="eval").body
        work, c = _Reader(text, frozenset(names), tables).read(tree)
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(f'"{text}" is not an expression; write it like "K*(x_N - x) - B*v"') from None
    return Expression(text, work, c)


@dataclass(frozen=True)
class _Reader:
    text: str
    names: frozenset[str]
    tables: Mapping[str, Callable[..., Any]]

    def read(self, node: ast.AST) -> tuple[Worked, str]:
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                number = _finite(value)
                return (lambda _: number), repr(number)
            case ast.Name(id=name):
                return self._name(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                work, c = self.read(operand)
                return (lambda values: -work(values)), f"(-{c})"
            case ast.BinOp(op=operator) if type(operator) in _BINARY:
                return self._pair(node.left, node.right, *_BINARY[type(operator)])
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._call(name, args)
            case ast.IfExp(test=ast.Compare(left=left, ops=[op], comparators=[right])) if type(op) in _COMPARISONS:
                return self._choice(self._pair(left, right, *_COMPARISONS[type(op)]), node.body, node.orelse)
        part = ast.get_source_segment(self.text.strip(), node) if hasattr(node, "lineno") else None
        raise ValueError(f'"{part or self.text}" in "{self.text}" cannot be worked out; use + - * / ** and functions')

    def _name(self, name: str) -> tuple[Worked, str]:
        if name in self.names:
            return (lambda values: values[name]), f"v_{name}"
        if name in CONSTANTS:
            constant = CONSTANTS[name]
            return (lambda _: constant), repr(float(constant))
        known = ", ".join(sorted(self.names))
        raise ValueError(f'"{name}" in "{self.text}" is not known; known are {known}')

    def _pair(self, left: ast.AST, right: ast.AST, sign: str, work: Callable[[Any, Any], Any]) -> tuple[Worked, str]:
        (one, one_c), (other, other_c) = self.read(left), self.read(right)
        c = f"pow({one_c}, {other_c})" if sign == "pow" else f"({one_c} {sign} {other_c})"
        return (lambda values: work(one(values), other(values))), c

    def _call(self, name: str, arguments: list[ast.expr]) -> tuple[Worked, str]:
        inner = [self.read(argument) for argument in arguments]
        works = [work for work, _ in inner]
        joined = ", ".join(c for _, c in inner)
        if name in self.tables:
            function, in_c = self.tables[name], f"network_{name}"
        elif name in FUNCTIONS and FUNCTIONS[name][0] == len(arguments):
            function, in_c = FUNCTIONS[name][1], _IN_C.get(name, name)
        else:
            known = ", ".join([*FUNCTIONS, *self.tables])
            raise ValueError(f'"{name}" of {len(arguments)} in "{self.text}" is not a function known; known: {known}')
        if len(works) == 1:
            only = works[0]
            return (lambda values: function(only(values))), f"{in_c}({joined})"
        return (lambda values: function(*(work(values) for work in works))), f"{in_c}({joined})"

    def _choice(self, test: tuple[Worked, str], yes: ast.expr, no: ast.expr) -> tuple[Worked, str]:
        (one, one_c), (other, other_c) = self.read(yes), self.read(no)
        decide = test[0]

        def work(values: Values) -> Any:
            chosen = decide(values)
            if isinstance(chosen, (bool, np.bool_)):
                return one(values) if chosen else other(values)
            return np.where(chosen, one(values), other(values))

        return work, f"({test[1]} ? {one_c} : {other_c})"


def _finite(value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = inf
    if not isfinite(number):
        raise ValueError("a number is too great to compute with; check its exponent")
    return number
