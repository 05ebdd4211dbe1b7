"""Reading the parts of a network file, with a sentence for what is wrong (docs/identification.md)."""

import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from norton_bench.errors import UsageError
from norton_bench.models.parameters import PredictionError
from norton_bench.models.terms import TERM_BY_NAME, NetworkTerm

FORMAT = "norton-network"
VERSION, VERSION_WITH_TERMS = 1, 2


def as_object(value: object) -> dict[str, Any]:
    """A table; an empty one for what is none."""
    return value if isinstance(value, dict) else {}


def read_json(path: Path | str) -> object:
    """The content. Raises UsageError for a file that cannot be read."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror}); give the path of a network file") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: is not text; give the path of a network file (JSON)") from error
    except json.JSONDecodeError as error:
        raise UsageError(
            f"{path}: line {error.lineno}: not valid JSON ({error.msg}); was the file cut short?"
        ) from error


def read_network(path: Path | str) -> dict[str, Any]:
    """The content of a network file, its format, version and command unit checked. Raises UsageError for others."""
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UsageError(f'{path}: not a network file; expected JSON with "format": "{FORMAT}"')
    version = content.get("version")
    if version not in (VERSION, VERSION_WITH_TERMS):
        raise UsageError(
            f"{path}: version {version!r} of the network file is unknown here; this program reads {VERSION} and "
            f"{VERSION_WITH_TERMS}"
        )
    if not isinstance(content.get("command_unit"), str):
        raise UsageError(f'{path}: "command_unit" is missing; add the unit of the command, such as "N*m"')
    return content


def term_as_json(term: NetworkTerm, command_unit: str) -> dict[str, Any]:
    """One of "terms"."""
    values = {
        each.name: {"value": value, "unit": each.unit_for(command_unit)}
        for each, value in zip(term.term.parameters, term.values, strict=True)
    }
    periods = {"periods_per_turn": term.periods_per_turn} if term.term.periodic else {}
    return {"name": term.name, "equation": term.term.equation, **periods, "parameters": values}


def read_term(path: Path | str, content: dict[str, Any]) -> NetworkTerm:
    """One of "terms". Raises UsageError for one that is not known."""
    name = content.get("name")
    if name not in TERM_BY_NAME:
        raise UsageError(f"{path}: this program knows no term {name!r}; it knows {', '.join(TERM_BY_NAME)}")
    term, parameters = TERM_BY_NAME[name], as_object(content.get("parameters"))
    values = []
    for each in term.parameters:
        value = as_object(parameters.get(each.name)).get("value")
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not isfinite(value):
            raise UsageError(f'{path}: term {name}: {each.name} needs a finite number under "value", not {value!r}')
        values.append(float(value))
    periods = content.get("periods_per_turn", 0)
    if not isinstance(periods, (int, float)) or (periods > 0) is not term.periodic:
        wanted = "periods_per_turn above zero" if term.periodic else "no periods_per_turn"
        raise UsageError(f"{path}: term {name} needs {wanted}, not {periods!r}")
    return NetworkTerm(name, tuple(values), periods)


def read_prediction(path: Path | str, content: object) -> PredictionError | None:
    """Of "prediction". Raises UsageError where it is none."""
    if content is None:
        return None
    try:
        return PredictionError.from_json(as_object(content))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f'{path}: "prediction" is not as docs/identification.md has it; leave it out') from error


def read_matrix(path: Path | str, covariance: dict[str, Any]) -> tuple[tuple[float, ...], ...]:
    """Of "covariance". Raises UsageError where it is none."""
    size = len(covariance.get("names", []))
    try:
        matrix = np.asarray(covariance.get("matrix", []), dtype=float).reshape(size, size)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"{path}: covariance.matrix must be {size} rows of {size} numbers, one for each name"
        ) from error
    return tuple(tuple(float(value) for value in row) for row in matrix)
