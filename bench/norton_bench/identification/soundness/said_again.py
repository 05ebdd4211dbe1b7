"""Readings that a driver said again because no message came, put where the sensor left one out.

A sensor that sends its value where that has changed says by its silence that it has not. A message that is merely late
looks alike at first: what was said again in its place is one reading too many, after which all that follow seem to be a
period later. Which it was shows when the late ones have come.
"""

import numpy as np

from norton_bench.identification.timing import count_readings, nominal_period_s
from norton_bench.records import Table


def one_a_period(table: Table) -> Table:
    """A table of readings in which one follows the other by a period, as the sensor took them.

    Messages are counted by their arrivals; those that are missing between two stand for the value before them, where
    the driver said anything again there. Tables of sensors that leave nothing out are returned as they are, and those
    whose rows bear no numbers of their own.
    """
    again = np.flatnonzero(np.diff(table["sequence"]) == 0) + 1
    if not again.size or np.any(table["torque_nm"][again] != table["torque_nm"][again - 1]):
        return table
    messages = np.setdiff1d(np.arange(len(table)), again)
    arrival_ns = table["arrival_ns"][messages]
    period_s = nominal_period_s(table["arrival_ns"])
    number = count_readings((arrival_ns - arrival_ns[0]) * 1e-9, period_s).astype(np.int64)
    # Where nothing was said again the sensor itself was silent, or messages were lost: a gap stays one.
    left_out = np.where(np.diff(messages) > 1, np.diff(number) - 1, 0)
    rows = np.repeat(np.arange(messages.size), np.append(left_out, 0) + 1)
    regular: Table = table[messages][rows]
    places = np.flatnonzero(np.diff(rows, prepend=-1))  # of the messages themselves
    regular["arrival_ns"] = np.interp(np.arange(rows.size), places, arrival_ns - arrival_ns[0]).round() + arrival_ns[0]
    regular = np.concatenate([regular, table[messages[-1] + 1 :]])  # after the last message nothing tells
    regular["sequence"] = np.arange(len(regular))
    return regular
