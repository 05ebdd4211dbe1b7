"""Networks in files: JSON with a version, the equations or matrices, and where they come from (docs/networks.md)."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.network_file import FORMAT as MOTOR_FORMAT
from norton_bench.networks.expressions import Equations, Table
from norton_bench.networks.family import Network
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator

FORMAT = "equivalent-network"
VERSION = 1
T = TypeVar("T")


def save(network: Network, path: Path | str) -> None:
    """Write any network as JSON. Raises UsageError, in a sentence, where that is impossible."""
    if isinstance(network, NortonNetwork):
        network.save(path)
        return
    written = _linear_json(network) if isinstance(network, LinearNetwork) else _nonlinear_json(network)
    content = {"format": FORMAT, "version": VERSION, **written, "provenance": dict(network.provenance)}
    try:
        Path(path).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot write the network file ({error.strerror}); choose another place") from error


def load(path: Path | str) -> Network:
    """Read any network file, an identified motor's included. Raises UsageError, in a sentence, for what is none."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror}); give the path of a network file") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: is not text; give the path of a network file (JSON)") from error
    except (json.JSONDecodeError, RecursionError) as error:
        if Path(path).suffix.lower() == ".toml":
            raise UsageError(f"{path}: is a TOML file; give a network file (JSON)") from error
        line = f"line {error.lineno}: " if isinstance(error, json.JSONDecodeError) else ""
        raise UsageError(f"{path}: {line}not valid JSON; was the file cut short?") from error
    result = content.get("format") if isinstance(content, dict) else None
    if result == MOTOR_FORMAT:
        return NortonNetwork.load(path)
    if result != FORMAT:
        raise UsageError(f'{path}: not a network file; expected JSON with "format": "{FORMAT}" or "{MOTOR_FORMAT}"')
    if content.get("version") != VERSION:
        version = content.get("version")
        raise UsageError(
            f"{path}: version {version!r} of the network file is unknown here; this program reads {VERSION}"
        )
    return _Reader(Path(path), content).network()


@dataclass(frozen=True)
class _Reader:
    """One file being read: every mistake is told with the file and the key."""

    path: Path
    content: Mapping[str, Any]

    def network(self) -> Network:
        kind = self._one_of("type", {kind.value: kind for kind in Kind})
        form = self._one_of("form", {form.value: form for form in Form})
        makers: dict[str, Callable[[], Network]] = {
            "linear": lambda: LinearNetwork(
                kind, form, self._operator("source"), self._operator("connection"), tuple(self._units().values()),
                self._provenance(),
            ),
            "nonlinear": lambda: NonlinearNetwork(
                kind, form, self._equations("source"), self._equations("connection"), self._units(),
                joined_linearly=self._one_of("joined", {"linearly": True, "nonlinearly": False}),
                step_s=self._number("step_s"),
                domain={name: self._range(name) for name in self._object("domain", optional=True)},
                provenance=self._provenance(),
            ),
        }  # fmt: skip
        maker: Callable[[], Network] = self._one_of("equations", makers)
        return self._told("equations", maker)

    def _operator(self, key: str) -> Operator:
        part = self._object(key)
        return self._told(key, lambda: Operator.of(part["A"], part["B"], part["C"], part["D"]))

    def _equations(self, key: str) -> Equations:
        part = self._object(key)

        def make() -> Equations:
            return Equations(
                inputs=tuple(str(name) for name in part.get("inputs", ())),
                outputs={name: str(text) for name, text in part["outputs"].items()},
                rates={name: str(text) for name, text in part.get("rates", {}).items()},
                initial={name: float(value) for name, value in part.get("initial", {}).items()},
                parameters={name: float(value) for name, value in part.get("parameters", {}).items()},
                tables={name: _table(value) for name, value in part.get("tables", {}).items()},
            )

        return self._told(key, make)

    def _told(self, key: str, make: Callable[[], T]) -> T:
        try:
            return make()
        except KeyError as error:
            raise UsageError(f"{self.path}: {key}: {error} is missing; see docs/networks.md") from error
        except (TypeError, AttributeError) as error:
            raise UsageError(f"{self.path}: {key}: a value is of the wrong kind; see docs/networks.md") from error
        except (ValueError, OverflowError) as error:
            raise UsageError(f"{self.path}: {key}: {error}") from error

    def _one_of(self, key: str, known: Mapping[str, Any]) -> Any:
        value = self.content.get(key)
        if not isinstance(value, str) or value not in known:
            choices = " or ".join(f'"{choice}"' for choice in known)
            raise UsageError(f'{self.path}: "{key}" is {value!r}; it must be {choices}')
        return known[value]

    def _object(self, key: str, *, optional: bool = False) -> dict[str, Any]:
        value = self.content.get(key, {} if optional else None)
        if not isinstance(value, dict):
            raise UsageError(f'{self.path}: "{key}" must be an object; see docs/networks.md')
        return value

    def _units(self) -> dict[str, str]:
        return {str(name): str(unit) for name, unit in self._object("commands").items()}

    def _provenance(self) -> dict[str, str]:
        return {str(name): str(text) for name, text in self._object("provenance", optional=True).items()}

    def _number(self, key: str) -> float:
        return self._told(key, lambda: float(self.content[key]))

    def _range(self, name: str) -> tuple[float, float]:
        def make() -> tuple[float, float]:
            low, high = self.content["domain"][name]
            return float(low), float(high)

        return self._told(f"domain of {name}", make)


def _table(content: Mapping[str, Any]) -> Table:
    nodes = tuple(tuple(float(node) for node in grid) for grid in content["nodes"])
    if len(nodes) == 2:
        return Table(nodes, tuple(tuple(float(value) for value in row) for row in content["values"]))
    return Table(nodes, tuple(float(value) for value in content["values"]))


def _linear_json(network: LinearNetwork) -> dict[str, Any]:
    return {
        "equations": "linear",
        "type": network.kind.value,
        "form": network.form.value,
        "commands": network.commands,
        "source": _operator_json(network.source),
        "connection": _operator_json(network.connection),
    }


def _operator_json(operator: Operator) -> dict[str, Any]:
    return {
        "A": operator.state.tolist(),
        "B": operator.entry.tolist(),
        "C": operator.exit.tolist(),
        "D": operator.direct.tolist(),
    }


def _nonlinear_json(network: NonlinearNetwork) -> dict[str, Any]:
    return {
        "equations": "nonlinear",
        "type": network.kind.value,
        "form": network.form.value,
        "joined": "linearly" if network.joined_linearly else "nonlinearly",
        "commands": dict(network.command_units),
        "step_s": network.step_s,
        "domain": {name: list(bounds) for name, bounds in network.domain.items()},
        "source": _equations_json(network.source),
        "connection": _equations_json(network.connection),
    }


def _equations_json(equations: Equations) -> dict[str, Any]:
    return {
        "inputs": list(equations.inputs),
        "outputs": dict(equations.outputs),
        "rates": dict(equations.rates),
        "initial": dict(equations.initial),
        "parameters": dict(equations.parameters),
        "tables": {
            name: {"nodes": [list(grid) for grid in table.nodes], "values": table.values}
            for name, table in equations.tables.items()
        },
    }
