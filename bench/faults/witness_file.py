"""The file in which ``sim serve --witness`` writes what is true, read while it grows."""

from pathlib import Path

from drivers.rehearsal import TrueState


def read_witness(path: Path) -> list[TrueState]:
    """All whole lines so far; stamps are of the machine's monotonic clock."""
    lines = path.read_text(encoding="ascii").split("\n")
    return [_state(line) for line in lines[1:-1]]  # after the last line end, a line may be half written


def _state(line: str) -> TrueState:
    stamp_ns, torque_nm, velocity_rad_s, load_velocity_rad_s, driving, armed = line.split(",")
    return TrueState(
        int(stamp_ns),
        float(torque_nm),
        float(velocity_rad_s),
        float(load_velocity_rad_s),
        _roles(driving),
        _roles(armed),
    )


def _roles(joined: str) -> tuple[str, ...]:
    return tuple(joined.split("+")) if joined else ()
