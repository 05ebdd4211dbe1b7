"""Faults as they are written in files: read, with a sentence for each mistake."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from norton_drivers.errors import WiringError
from norton_drivers.wiring import Wiring
from norton_sim.faults.schema import KINDS, Fault
from norton_sim.tables import complaints, keys_of, nearest


def read_faults(tables: object, wiring: Wiring, *, place: str, section: str) -> tuple[Fault, ...]:
    """The faults written as ``[[section]]`` tables in the file ``place``, in their order.

    Raises WiringError, one sentence for each mistake with its place and the mend.
    """
    if not isinstance(tables, Sequence) or isinstance(tables, str):
        raise WiringError(f"{place}: [{section}] should be a list of tables: write [[{section}]], in double brackets")
    faults: list[Fault] = []
    sentences: list[str] = []
    for number, table in enumerate(tables, 1):
        found = _read(table, wiring, place, f"{section} {number}")
        if isinstance(found, Fault):
            faults.append(found)
        else:
            sentences += found
    if sentences:
        raise WiringError("\n".join(sentences))
    return tuple(faults)


def _read(table: object, wiring: Wiring, place: str, name: str) -> Fault | list[str]:
    """The fault, or what is wrong with it."""
    if not isinstance(table, Mapping):
        return [f"{place}: [{name}] should be a table with kind = ..., not {table!r}"]
    model = KINDS.get(str(table.get("kind")))
    if model is None:
        return [f"{place}: [{name}] kind {_kind_mend(table.get('kind'))}"]
    return _filled(model, {key: value for key, value in table.items() if key != "kind"}, wiring, place, name)


def _filled(model: type[Fault], written: Mapping[str, Any], wiring: Wiring, place: str, name: str) -> Fault | list[str]:
    name = f"{name}, {model.kind}"
    known = keys_of(model)
    strange = [f"{place}: [{name}] {key} is not known; {nearest(key, known)}" for key in written if key not in known]
    try:
        # With a context, so that numbers without a unit are refused: they come from a file.
        fault = model.model_validate({key: written[key] for key in written if key in known}, context={"place": place})
    except ValidationError as error:
        return [*strange, *complaints(error, model, written, place=place, name=name)]
    misplaced = fault.complaint(wiring)
    if misplaced is not None:
        strange.append(f"{place}: [{name}] {misplaced[0]}: {misplaced[1]}")
    return strange or fault


def _kind_mend(kind: object) -> str:
    if kind is None:
        return f'is missing; add kind = "drop" (or {", ".join(list(KINDS)[1:])})'
    close = get_close_matches(str(kind).lower(), KINDS, n=1)
    mend = f'did you mean "{close[0]}"?' if close else f"known: {', '.join(KINDS)}"
    return f'= "{kind}" is no fault; {mend}'
