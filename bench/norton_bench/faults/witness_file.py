"""The file in which ``sim serve --witness`` writes what is true, read while it grows."""

import os
from pathlib import Path

from norton_drivers.rehearsal import TrueState

LONGEST_LINE = 200


def read_witness(path: Path) -> list[TrueState]:
    """All whole lines so far; stamps are of the machine's monotonic clock."""
    return _states(path.read_bytes().split(b"\n")[1:])


def last_state(path: Path) -> TrueState | None:
    """The last whole line, without reading the others; None where there is none yet."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 2 * LONGEST_LINE))
        # What stands before the first line end is the names of the columns, or half a line.
        states = _states(file.read().split(b"\n")[1:])
    return states[-1] if states else None


def _states(lines: list[bytes]) -> list[TrueState]:
    """What stands after the last line end may be half written."""
    return [_state(line.decode("ascii")) for line in lines[:-1]]


def _state(line: str) -> TrueState:
    stamp_ns, torque_nm, velocity_rad_s, load_velocity_rad_s, driving, armed = line.split(",")
    motion = (float(torque_nm), float(velocity_rad_s), float(load_velocity_rad_s))
    return TrueState(int(stamp_ns), *motion, _roles(driving), _roles(armed))


def _roles(joined: str) -> tuple[str, ...]:
    return tuple(joined.split("+")) if joined else ()
