"""What may go wrong with a recording, as functions from a good one to a bad one."""

from dataclasses import replace

import numpy as np


def values(table, column, change):
    """A column's values (n,) become ``change(values)``."""

    def of(measured):
        rows = getattr(measured, table).copy()
        rows[column] = change(rows[column].copy())
        return replace(measured, **{table: rows})

    return of


def torque(change):
    return values("torque", "torque_nm", change)


def position(change):
    return values("motion", "position_rad", change)


def command(change):
    return values("ticks", "command", change)


def rows(table, change):
    """The rows of a table become ``change(rows)``."""
    return lambda measured: replace(measured, **{table: change(getattr(measured, table))})


def spots(bad, count, span=1):
    """So many spans of bad values."""

    def change(good):
        for start in np.random.default_rng(1).integers(0, len(good) - span, count):
            good[start : start + span] = bad
        return good

    return change


def without(count, pieces=1, at=0.6):
    """Pieces of so many rows are missing."""

    def change(table):
        keep = np.ones(len(table), dtype=bool)
        starts = [int(at * len(table))] if pieces == 1 else np.random.default_rng(2).integers(0, len(table), pieces)
        for start in starts:
            keep[start : start + count] = False
        return table[keep]

    return change


def stepped(by, at=0.5):
    """From the middle on, everything is this much more."""

    def change(good):
        good[int(at * len(good)) :] += by
        return good

    return change


def stuck(begin, end):
    def change(good):
        first, last = int(begin * len(good)), int(end * len(good))
        good[first:last] = good[first]
        return good

    return change


def held(every):
    return lambda good: good[np.arange(len(good)) // every * every]


def clipped(share):
    return lambda good: np.clip(good, -share * np.abs(good).max(), share * np.abs(good).max())


def slipping(good):
    """One count in a hundred is lost, one way."""
    steps = np.diff(good, prepend=good[0])
    return np.cumsum(np.where(steps > 0, 1.0, 0.99) * steps)


def shuffled(table):
    return table[np.random.default_rng(4).permutation(len(table))]


def late(table, by_ns):
    """A whole stream comes later."""

    def of(measured):
        later = getattr(measured, table).copy()
        for column in {"arrival_ns", "device_ns"} & set(later.dtype.names):
            later[column] += by_ns
        return replace(measured, **{table: later})

    return of


def torque_and_velocity_swapped(measured):
    torque_rows, motion = measured.torque.copy(), measured.motion.copy()
    told, speed = torque_rows["torque_nm"].copy(), motion["velocity_rad_s"].copy()
    scale = np.std(speed) / np.std(told)
    torque_rows["torque_nm"], motion["position_rad"] = speed / scale, np.cumsum(told * scale) * 1e-3
    return replace(measured, torque=torque_rows, motion=motion)


def motions_swapped(measured):
    return replace(measured, motion=measured.load_motion, load_motion=measured.motion)


def commands_swapped(measured):
    ticks = measured.ticks.copy()
    ticks["command"], ticks["load_torque_nm"] = measured.ticks["load_torque_nm"], measured.ticks["command"]
    return replace(measured, ticks=ticks)


def part(start_s, length_s):
    def of(measured):
        start_ns = int(measured.ticks["tick_ns"][0]) + round(start_s * 1e9)
        return measured.between(start_ns, start_ns + round(length_s * 1e9))

    return of


def moved_segments(by_ns):
    def of(measured):
        moved = [
            replace(each, start_ns=each.start_ns + by_ns, end_ns=each.end_ns + by_ns) for each in measured.segments
        ]
        return replace(measured, segments=tuple(moved))

    return of


def one_way(measured):
    return replace(measured, motion=measured.motion[measured.motion["velocity_rad_s"] > 0])
