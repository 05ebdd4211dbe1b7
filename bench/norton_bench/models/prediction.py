"""How far a network's predictions are off, and where that was seen: it goes with the network's file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

NAN = float("nan")
UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2"}


@dataclass(frozen=True)
class PredictionError:
    """What the rms error over some seconds of a motion not seen before stays below, in ``level`` of such stretches.

    ``torque_nm`` under a measured motion, ``velocity_rad_s`` of the free motion under a command; NaN where it was not
    seen. Neither the sensors' noise nor their zero is in them. ``ranges`` has, for "velocity" [rad/s], "acceleration"
    [rad/s²] and "command" [its unit], the least and the greatest value that they were seen with: they hold within.
    """

    torque_nm: float = NAN
    velocity_rad_s: float = NAN
    level: float = NAN
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def as_json(self, command_unit: str) -> dict[str, Any]:
        """As in a network file; what is not known is null."""
        return {
            "torque": {"value": _known(self.torque_nm), "unit": "N*m"},
            "free_velocity": {"value": _known(self.velocity_rad_s), "unit": "rad/s"},
            "level": _known(self.level),
            "ranges": {
                name: {"from": low, "to": high, "unit": UNITS.get(name, command_unit)}
                for name, (low, high) in self.ranges.items()
            },
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "PredictionError":
        """The reverse. Raises KeyError, TypeError or ValueError for what is none."""
        ranges = {str(name): (float(span["from"]), float(span["to"])) for name, span in content["ranges"].items()}
        torque, velocity = content["torque"]["value"], content["free_velocity"]["value"]
        return cls(_number(torque), _number(velocity), _number(content["level"]), ranges)


def _known(value: float) -> float | None:
    return value if isfinite(value) else None


def _number(value: float | None) -> float:
    return NAN if value is None else float(value)
