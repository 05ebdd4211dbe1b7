"""The parts of a network file, each read with a sentence for what is wrong in it."""

import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from norton_bench.errors import UsageError
from norton_bench.models.parameters import PredictionError
from norton_bench.models.terms import TERM_BY_NAME, NetworkTerm


def entries(value: object) -> dict[str, Any]:
    """Its entries; none where it is no object."""
    return value if isinstance(value, dict) else {}


def read_json(path: Path | str) -> object:
    """A file's content. Raises UsageError for one that cannot be read, or is no JSON."""
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


def read_term(path: Path | str, content: dict[str, Any]) -> NetworkTerm:
    """A term with its values. Raises UsageError for what is none."""
    name = content.get("name")
    if name not in TERM_BY_NAME:
        raise UsageError(f"{path}: this program knows no term {name!r}; it knows {', '.join(TERM_BY_NAME)}")
    term, parameters = TERM_BY_NAME[name], entries(content.get("parameters"))
    values = []
    for each in term.parameters:
        value = entries(parameters.get(each.name)).get("value")
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not isfinite(value):
            raise UsageError(f'{path}: term {name}: {each.name} needs a finite number under "value", not {value!r}')
        values.append(float(value))
    periods = content.get("periods_per_turn", 0)
    if not isinstance(periods, (int, float)) or (periods > 0) is not term.periodic:
        wanted = "periods_per_turn above zero" if term.periodic else "no periods_per_turn"
        raise UsageError(f"{path}: term {name} needs {wanted}, not {periods!r}")
    return NetworkTerm(name, tuple(values), periods)


def read_prediction(path: Path | str, content: object) -> PredictionError | None:
    """Raises UsageError for what is none."""
    if content is None:
        return None
    try:
        return PredictionError.from_json(entries(content))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f'{path}: "prediction" is not as docs/identification.md has it; leave it out') from error


def read_matrix(path: Path | str, covariance: dict[str, Any]) -> tuple[tuple[float, ...], ...]:
    """The covariance, row by row. Raises UsageError for what is none."""
    size = len(covariance.get("names", []))
    try:
        matrix = np.asarray(covariance.get("matrix", []), dtype=float).reshape(size, size)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"{path}: covariance.matrix must be {size} rows of {size} numbers, one for each name"
        ) from error
    return tuple(tuple(float(value) for value in row) for row in matrix)
