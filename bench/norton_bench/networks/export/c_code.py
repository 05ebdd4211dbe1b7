"""A network as one self-contained C header (C99): its equations, and a step function that integrates them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.networks.expressions import Equations, Expression, Table
from norton_bench.networks.family import Network, commands_of, form_of
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.linear import LinearNetwork, check_derivatives, joint
from norton_bench.networks.motor import as_equations
from norton_bench.networks.nonlinear import MOTIONS, NonlinearNetwork
from norton_bench.networks.operator import Operator

UNITS = {"x": "rad", "v": "rad/s", "a": "rad/s^2", "f": "N m"}
# A Runge-Kutta step of this part of the fastest pole's time leaves an error of 1e-8 in it.
PART_OF_FASTEST = 0.1


@dataclass(frozen=True)
class Written:
    """A network in C: functions <prefix>_rates and <prefix>_outputs of states, commands and port.

    ``start`` has the states' first values, ``commands`` units by name, ``port`` and ``outputs`` names of ``UNITS``."""

    prefix: str
    functions: str
    start: tuple[float, ...]
    commands: Mapping[str, str]
    port: tuple[str, ...]
    outputs: tuple[str, ...]
    step_s: float


def write_network(network: Network, name: str) -> Written:
    """``name`` becomes the prefix of all names in C. Raises UsageError where the network cannot be stepped."""
    prefix = prefix_of(name)
    match network:
        case LinearNetwork():
            return _linear(network, prefix)
        case NortonNetwork():
            return _nonlinear(as_equations(network), prefix)
    return _nonlinear(network, prefix)


def header(network: Network, name: str) -> str:
    """The header's text. Raises UsageError where the network cannot be stepped."""
    written = write_network(network, name)
    p, guard = written.prefix, f"{written.prefix.upper()}_NETWORK_H"
    n, m = len(written.start), len(written.commands)
    lines = [
        f"/* An equivalent network ({_shape(network)}), exported by norton-bench. C99, no dependencies but math.h.",
        " *",
        f" *   {p}_network n;",
        f" *   {p}_start(&n);",
        f" *   {p}_step(&n, dt_s, command, port, output);   at every tick",
        " *",
        " * A step takes what holds at this tick. Since the last one the command was held and the port moved linearly.",
        f" * Steps of integration are at most {written.step_s:.6g} s (Runge-Kutta, fourth order).",
        " *",
        f" * command: {_listed(written.commands)}",
        f" * port:    {_listed({each: UNITS[each] for each in written.port})}",
        f" * output:  {_listed({each: UNITS[each] for each in written.outputs})}",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "#include <math.h>",
        "",
        f"#define {p.upper()}_STATES {n}",
        f"#define {p.upper()}_COMMANDS {m}",
        f"#define {p.upper()}_PORT {len(written.port)}",
        f"#define {p.upper()}_OUTPUTS {len(written.outputs)}",
        "",
        _STRUCT.replace("NAME", p).replace("SIZE_S", str(max(n, 1))).replace("SIZE_C", str(max(m, 1)))
        .replace("SIZE_P", str(len(written.port))),
        written.functions,
        _stepping(written),
        f"#endif /* {guard} */",
        "",
    ]  # fmt: skip
    return "\n".join(lines)


def prefix_of(name: str) -> str:
    """A name that C accepts."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "network"
    return plain if plain[0].isalpha() else f"n_{plain}"


_STRUCT = """\
typedef struct {
    double state[SIZE_S];
    double command[SIZE_C];
    double port[SIZE_P];
    int begun;
} NAME_network;
"""

_STEPPING = """\
/* State after dt_s: the command held, the port going from one value to another. */
static inline void NAME_advance(double *state, double dt_s, const double *command, const double *from, const double *to)
{
    const int steps = dt_s > STEP ? (int)ceil(dt_s / STEP - 1e-9) : 1;
    const double h = dt_s / steps;
    double rate[4][SIZE_S], at[SIZE_S], port[SIZE_P];
    for (int k = 0; k < steps; ++k) {
        for (int stage = 0; stage < 4; ++stage) {
            const double reach = stage == 0 ? 0.0 : stage == 3 ? 1.0 : 0.5;
            const double part = (k + reach) / steps;
            for (int i = 0; i < STATES; ++i)
                at[i] = state[i] + (stage ? reach * h * rate[stage - 1][i] : 0.0);
            for (int i = 0; i < SIZE_P; ++i)
                port[i] = from[i] + part * (to[i] - from[i]);
            NAME_rates(at, command, port, rate[stage]);
        }
        for (int i = 0; i < STATES; ++i)
            state[i] += h / 6.0 * (rate[0][i] + 2.0 * rate[1][i] + 2.0 * rate[2][i] + rate[3][i]);
    }
}
"""

_STATELESS = """\
/* A network without states has nothing to advance. */
static inline void NAME_advance(double *state, double dt_s, const double *command, const double *from, const double *to)
{
    (void)state; (void)dt_s; (void)command; (void)from; (void)to;
}
"""

_STEP = """\
static inline void NAME_start(NAME_network *n)
{
    static const double first[SIZE_S] = {START};
    for (int i = 0; i < SIZE_S; ++i)
        n->state[i] = first[i];
    n->begun = 0;
}

static inline void NAME_step(NAME_network *n, double dt_s, const double *command, const double *port, double *output)
{
    if (n->begun)
        NAME_advance(n->state, dt_s, n->command, n->port, port);
    for (int i = 0; i < COMMANDS; ++i)
        n->command[i] = command[i];
    for (int i = 0; i < SIZE_P; ++i)
        n->port[i] = port[i];
    n->begun = 1;
    NAME_outputs(n->state, command, port, output);
}
"""


def _stepping(written: Written) -> str:
    n = len(written.start)
    text = (_STEPPING if n else _STATELESS) + "\n" + _STEP
    values = {
        "NAME": written.prefix,
        "STEP": _number(written.step_s),
        "SIZE_S": str(max(n, 1)),
        "SIZE_P": str(len(written.port)),
        "STATES": str(n),
        "COMMANDS": str(len(written.commands)),
        "START": ", ".join(map(_number, written.start)) or "0.0",
    }
    if not written.commands:
        text = text.replace("    for (int i = 0; i < COMMANDS; ++i)\n        n->command[i] = command[i];\n", "")
    return re.sub("|".join(rf"\b{key}(?=\b|_)" for key in values), lambda result: values[result[0]], text)


def _linear(network: LinearNetwork, prefix: str) -> Written:
    whole = joint(network)
    m = len(network.command_units)
    port = MOTIONS if network.form is Form.IMPEDANCE else ("f",)
    check_derivatives(whole, m, len(port))
    speeds = np.abs(whole.poles())
    step_s = PART_OF_FASTEST / float(speeds.max()) if speeds.max(initial=0.0) > 0.0 else 1.0
    outputs = ("f",) if network.form is Form.IMPEDANCE else ("x",)
    return Written(
        prefix,
        _linear_functions(whole, m, prefix),
        (0.0,) * whole.order,
        commands_of(network),
        port,
        outputs,
        min(step_s, 1.0),
    )


def _linear_functions(whole: Operator, m: int, prefix: str) -> str:
    signals = [f"c[{i}]" for i in range(m)]
    states = [f"s[{i}]" for i in range(whole.order)]
    rates = [
        f"    rate[{i}] = {_sum([*whole.state[i], *whole.entry[i]], [*states, *signals, 'p[0]'])};"
        for i in range(whole.order)
    ]
    gains = [*whole.exit, *whole.direct[0, :m], *whole.direct[:, m]]
    output = _sum(gains, [*states, *signals, *(f"p[{k}]" for k in range(len(whole.direct)))])
    return _functions(prefix, rates, [f"    out[0] = {output};"])


def _functions(prefix: str, rates: Iterable[str], outputs: Iterable[str], before: str = "") -> str:
    unused = "    (void)s; (void)c; (void)p;"
    parts = [before] if before else []
    for what, result, body in (("rates", "rate", rates), ("outputs", "out", outputs)):
        lines = list(body)
        parts.append(
            f"static inline void {prefix}_{what}(const double *s, const double *c, const double *p, double *{result})\n"
            + "{\n"
            + "\n".join([f"{unused} (void){result};", *lines])
            + "\n}\n"
        )
    return "\n".join(parts)


def _nonlinear(network: NonlinearNetwork, prefix: str) -> Written:
    outputs = tuple(
        name
        for name, far in zip(network.port_out, _far(network), strict=True)
        if name + network.suffix in network.connection.outputs and (not network.suffix or far in network.source.outputs)
    )
    tables = {**network.source.tables, **network.connection.tables}
    if len(tables) < len(network.source.tables) + len(network.connection.tables):
        shared = next(iter(set(network.source.tables) & set(network.connection.tables)))
        raise UsageError(f'"{shared}" is a table of source and connection both; give one of them another name')
    body = _bodies(network, outputs)
    before = "\n".join([_SIGN, *(_table(name, table) for name, table in tables.items())])
    text = _functions(prefix, body[0], body[1], before)
    return Written(
        prefix,
        re.sub(r"\bnetwork_(?=\w+\()", f"{prefix}_", text),
        tuple(network.start.values()),
        dict(network.command_units),
        network.port_in,
        outputs,
        network.step_s,
    )


def _far(network: NonlinearNetwork) -> tuple[str, ...]:
    """What the source calls each of the port's outputs, where a linear connection is beside it."""
    return network.source_out if network.suffix else network.port_out


def _bodies(network: NonlinearNetwork, outputs: Sequence[str]) -> tuple[list[str], list[str]]:
    """Statements of the rates and of the outputs."""
    commands = {name: f"c[{i}]" for i, name in enumerate(network.command_units)}
    states = {name: f"s[{i}]" for i, name in enumerate(network.start)}
    port = {name: f"p[{i}]" for i, name in enumerate(network.port_in)}
    far = {name: f"o_{name}" for name in network.source.outputs}
    inputs = {**states, **commands, **port, **far}
    if network.deviates:
        pairs = zip(network.source_out, network.port_in, strict=True)
        inputs |= {f"d{near}": f"(o_{name} - {port[near]})" for name, near in pairs if name in far}
    source = _block(network.source, {**states, **commands}, network.source.read_outputs, "o_{}", declared=True)
    places = {name: f"rate[{i}]" for i, name in enumerate(states)}
    rates = [
        *source,
        *_block(network.source, {**states, **commands}, network.source.read_rates, places),
        *_block(network.connection, inputs, network.connection.read_rates, places),
    ]
    wanted = {name: network.connection.read_outputs[name + network.suffix] for name in outputs}
    targets = {name: f"out[{i}]" for i, name in enumerate(outputs)}
    closing = []
    if network.suffix:
        names = dict(zip(network.port_out, network.source_out, strict=True))
        closing = [f"    {targets[name]} = o_{names[name]} - {targets[name]};" for name in outputs]
    return rates, [*source, *_block(network.connection, inputs, wanted, targets), *closing]


def _block(
    equations: Equations,
    inputs: Mapping[str, str],
    expressions: Mapping[str, Expression],
    targets: Mapping[str, str] | str,
    *,
    declared: bool = False,
) -> list[str]:
    """Assignments in a scope of their own, with the names that they use and no others."""
    if not expressions:
        return []
    where = {name: targets.format(name) if isinstance(targets, str) else targets[name] for name in expressions}
    used = set(re.findall(r"\bv_(\w+)\b", " ".join(expression.c for expression in expressions.values())))
    known = {**inputs, **{name: _number(value) for name, value in equations.parameters.items()}}
    lines = [f"    double {', '.join(where.values())};"] if declared else []
    lines += ["    {"]
    lines += [f"        const double v_{name} = {known[name]};" for name in sorted(used)]
    lines += [f"        {where[name]} = {expression.c};" for name, expression in expressions.items()]
    lines += ["    }"]
    if declared:
        lines += [f"    (void){name};" for name in where.values()]
    return lines


_SIGN = """\
static inline double network_sign(double value)
{
    return (value > 0.0) - (value < 0.0);
}

static inline double network_place(const double *grid, int count, double value, int *below)
{
    int i = 0;
    if (value <= grid[0]) { *below = 0; return 0.0; }
    if (value >= grid[count - 1]) { *below = count - 2; return 1.0; }
    while (i < count - 2 && value >= grid[i + 1])
        ++i;
    *below = i;
    return (value - grid[i]) / (grid[i + 1] - grid[i]);
}
"""


def _table(name: str, table: Table) -> str:
    grids = [f"    static const double g{i}[] = {{{_numbers(grid)}}};" for i, grid in enumerate(table.nodes)]
    values = np.asarray(table.values, dtype=float)
    data = f"    static const double value[] = {{{_numbers(values.ravel())}}};"
    if len(table.nodes) == 1:
        rest = [
            "    int i;",
            f"    const double p = network_place(g0, {values.size}, a, &i);",
            "    return (1.0 - p) * value[i] + p * value[i + 1];",
        ]
        return _function(f"network_{name}(double a)", [*grids, data, *rest])
    rows, columns = values.shape
    rest = [
        "    int i, j;",
        f"    const double p = network_place(g0, {rows}, a, &i), q = network_place(g1, {columns}, b, &j);",
        f"    const double *low = value + i * {columns} + j, *high = low + {columns};",
        "    return (1.0 - p) * ((1.0 - q) * low[0] + q * low[1]) + p * ((1.0 - q) * high[0] + q * high[1]);",
    ]
    return _function(f"network_{name}(double a, double b)", [*grids, data, *rest])


def _function(signature: str, lines: Sequence[str]) -> str:
    return "\n".join([f"static inline double {signature}", "{", *lines, "}", ""])


def _sum(gains: Iterable[float], signals: Iterable[str]) -> str:
    terms = [f"{_number(gain)} * {signal}" for gain, signal in zip(gains, signals, strict=False) if gain]
    return " + ".join(terms) or "0.0"


def _number(value: float) -> str:
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(repr(float(value)) for value in values)


def _listed(units: Mapping[str, str]) -> str:
    text = ", ".join(f"{name} [{unit or '-'}]" for name, unit in units.items()) or "none"
    # A unit is what somebody wrote: it must not end the comment that it stands in.
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "").replace("?", "").split())


def _shape(network: Network) -> str:
    kind = Kind.NORTON if isinstance(network, NortonNetwork) else network.kind
    return f"{'Norton' if kind is Kind.NORTON else 'Thevenin'}, {form_of(network).value} form"
