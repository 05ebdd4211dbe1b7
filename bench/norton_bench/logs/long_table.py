"""Tables with one value a row, behind the name of what it is: the CSV of Foxglove's plots."""

from collections.abc import Mapping

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.logs.messages import Columns

NAME, VALUE = "topic", "value"
# In seconds; the first that every row has.
TIMES = ("header.stamp", "receive time", "receive_time", "elapsed time", "timestamp", "time")


def by_name(table: Mapping[str, object]) -> Columns | None:
    """The columns that the rows name, each with its times; None for a table of another kind."""
    if NAME not in table or VALUE not in table:
        return None
    names, values = np.asarray(table[NAME], dtype=object), _numbers(table[VALUE])
    times = [found for each in TIMES if each in table and (found := _numbers(table[each])) is not None]
    time_s = next((each for each in times if np.all(np.isfinite(each))), None)
    if values is None or time_s is None:
        return None
    since_s = time_s - time_s.min()
    rows = {str(name): np.flatnonzero(names == name) for name in dict.fromkeys(names)}
    return Columns(
        {name: values[each] for name, each in rows.items()}, {name: since_s[each] for name, each in rows.items()}
    )


def _numbers(column: object) -> FloatArray | None:
    try:
        return np.asarray(column).astype(np.float64)
    except (TypeError, ValueError):
        return None
