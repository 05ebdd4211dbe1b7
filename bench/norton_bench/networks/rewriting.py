"""Expressions put together and taken apart: names exchanged for expressions, what is linear in a name, and slopes."""

import ast
from collections.abc import Iterable, Mapping

from norton_bench.networks.expressions import LONGEST

# Functions call themselves a few times for each level.
DEEPEST = 200
_ONE = ast.Constant(1)
# What is multiplied with the argument's slope, of a function of one argument "_".
_SLOPES = {
    "sin": "cos(_)",
    "cos": "-sin(_)",
    "tan": "1/cos(_)**2",
    "asin": "1/sqrt(1 - _**2)",
    "acos": "-1/sqrt(1 - _**2)",
    "atan": "1/(1 + _**2)",
    "sinh": "cosh(_)",
    "cosh": "sinh(_)",
    "tanh": "1/cosh(_)**2",
    "exp": "exp(_)",
    "log": "1/_",
    "sqrt": "1/(2*sqrt(_))",
    "abs": "sign(_)",
}


def substituted(text: str, replacements: Mapping[str, str]) -> str:
    """The expression with names (of tables too) exchanged for expressions, all at once.

    Raises ValueError, in a sentence, where it becomes longer, or is nested deeper, than can be.
    """
    trees = {name: _tree(other) for name, other in replacements.items()}
    result = ast.unparse(_Exchanged(trees).visit(_tree(text)))
    if len(result) > LONGEST:
        raise ValueError(f"written as one, the equations have more than {LONGEST} characters; simplify them first")
    return result


def names_in(texts: Iterable[str]) -> frozenset[str]:
    """All names in the expressions, those of functions too."""
    return frozenset(node.id for text in texts for node in ast.walk(_tree(text)) if isinstance(node, ast.Name))


def linear_in(text: str, name: str) -> tuple[str, str] | None:
    """``slope`` and ``rest`` of slope*name + rest, neither of which has the name in it; None where it is no such sum.

    The slope is "0" where the expression does not have the name.
    """
    tree = _tree(text)
    try:
        slope, rest = _split(tree, name)
    except ValueError:
        return None
    return ("0" if slope is None else ast.unparse(slope)), ("0" if rest is None else ast.unparse(rest))


def solved(given: str, slope: str, rest: str) -> str:
    """The name of which ``given`` is slope*name + rest, in brackets."""
    above = given if rest == "0" else negative(rest) if given == "0" else f"{given} - ({rest})"
    if slope in ("1", "-1"):
        return f"({above if slope == '1' else negative(above)})"
    return f"(({above})/({slope}))"


def negative(text: str) -> str:
    """The expression with the other sign."""
    return ast.unparse(_negative(_tree(text)))


def slope_of(text: str, name: str) -> str:
    """The derivative with respect to a name. Raises ValueError for a table, and for what has none of its own."""
    slope = _derived(_tree(text), name)
    return "0" if slope is None else ast.unparse(slope)


def summands(text: str) -> list[str]:
    """The expressions whose sum the expression is."""
    return [ast.unparse(each) for each in _terms(_tree(text))]


def _tree(text: str) -> ast.expr:
    """Raises ValueError where brackets, or summands, lie within each other more than ``DEEPEST`` times."""
    tree = ast.parse(text.strip(), mode="eval").body
    level: list[ast.AST] = [tree]
    for _ in range(DEEPEST):
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        if not level:
            return tree
    raise ValueError(f"the equations are nested more than {DEEPEST} deep; simplify them first")


class _Exchanged(ast.NodeTransformer):
    def __init__(self, trees: Mapping[str, ast.expr]) -> None:
        self._trees = trees

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._trees.get(node.id, node)


def _terms(node: ast.expr) -> list[ast.expr]:
    match node:
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return [*_terms(left), *_terms(right)]
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return [*_terms(left), *map(_negative, _terms(right))]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return list(map(_negative, _terms(operand)))
    return [node]


def _has(node: ast.AST, name: str) -> bool:
    return any(isinstance(each, ast.Name) and each.id == name for each in ast.walk(node))


Parts = tuple[ast.expr | None, ast.expr | None]  # None is zero


def _split(node: ast.expr, name: str) -> Parts:
    """Slope and rest. Raises ValueError where the name does not enter linearly."""
    if not _has(node, name):
        return None, node
    match node:
        case ast.Name():
            return _ONE, None
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            slope, rest = _split(operand, name)
            return _minus(None, slope), _minus(None, rest)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            join = _plus if isinstance(op, ast.Add) else _minus
            (one, two), (three, four) = _split(left, name), _split(right, name)
            return join(one, three), join(two, four)
        case ast.BinOp(left=left, op=op, right=right):
            return _split_product(left, op, right, name)
        case ast.IfExp(test=test, body=body, orelse=orelse) if not _has(test, name):
            (one, two), (three, four) = _split(body, name), _split(orelse, name)
            return _chosen(test, one, three), _chosen(test, two, four)
    raise ValueError


def _split_product(left: ast.expr, op: ast.operator, right: ast.expr, name: str) -> Parts:
    """Of products and quotients, where one side does not have the name."""
    factor, other = (left, right) if isinstance(op, ast.Mult) and not _has(left, name) else (right, left)
    if not isinstance(op, (ast.Mult, ast.Div)) or _has(factor, name):
        raise ValueError
    by = _times if isinstance(op, ast.Mult) else _over
    slope, rest = _split(other, name)
    return by(slope, factor), by(rest, factor)


def _derived(node: ast.expr, name: str) -> ast.expr | None:
    if not _has(node, name):
        return None
    match node:
        case ast.Name():
            return _ONE
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _minus(None, _derived(operand, name))
        case ast.BinOp(left=left, op=op, right=right):
            return _derived_pair(left, op, right, name)
        case ast.Call(func=ast.Name(id=function), args=[argument]) if function in _SLOPES:
            outer = _Exchanged({"_": argument}).visit(_tree(_SLOPES[function]))
            return _times(outer, _derived(argument, name))
        case ast.IfExp(test=test, body=body, orelse=orelse):
            return _chosen(test, _derived(body, name), _derived(orelse, name))
    raise ValueError(f'"{ast.unparse(node)}" has no derivative in these equations; write it with sin, exp and the like')


def _derived_pair(left: ast.expr, op: ast.operator, right: ast.expr, name: str) -> ast.expr | None:
    one, other = _derived(left, name), _derived(right, name)
    match op:
        case ast.Add():
            return _plus(one, other)
        case ast.Sub():
            return _minus(one, other)
        case ast.Mult():
            return _plus(_times(one, right), _times(left, other))
        case ast.Div():
            return _minus(_over(one, right), _over(_times(left, other), ast.BinOp(right, ast.Mult(), right)))
    if other is not None:
        raise ValueError(f'"{ast.unparse(ast.BinOp(left, op, right))}" has {name} in its exponent; write it with exp')
    lower = ast.BinOp(left, ast.Pow(), ast.BinOp(right, ast.Sub(), _ONE))
    return _times(_times(right, lower), one)


def _plus(one: ast.expr | None, other: ast.expr | None) -> ast.expr | None:
    return other if one is None else one if other is None else ast.BinOp(one, ast.Add(), other)


def _minus(one: ast.expr | None, other: ast.expr | None) -> ast.expr | None:
    if other is None:
        return one
    return _negative(other) if one is None else ast.BinOp(one, ast.Sub(), other)


def _negative(node: ast.expr) -> ast.expr:
    match node:
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return operand
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            return ast.BinOp(_negative(left), ast.Sub() if isinstance(op, ast.Add) else ast.Add(), right)
        case ast.BinOp(left=ast.UnaryOp(op=ast.USub(), operand=left), op=ast.Mult() | ast.Div() as op, right=right):
            return ast.BinOp(left, op, right)
    return ast.UnaryOp(ast.USub(), node)


def _times(one: ast.expr | None, other: ast.expr | None) -> ast.expr | None:
    if one is None or other is None:
        return None
    return other if one is _ONE else one if other is _ONE else ast.BinOp(one, ast.Mult(), other)


def _over(one: ast.expr | None, other: ast.expr | None) -> ast.expr | None:
    return None if one is None or other is None else ast.BinOp(one, ast.Div(), other)


def _chosen(test: ast.expr, one: ast.expr | None, other: ast.expr | None) -> ast.expr | None:
    if one is None and other is None:
        return None
    return ast.IfExp(test, one or ast.Constant(0), other or ast.Constant(0))
