"""A servo's loop in a network file."""

from math import isfinite
from pathlib import Path
from typing import Any

from norton_bench.errors import UsageError
from norton_drivers.servo import SHORTEST_WINDOW_S, Servo

# Its quantities: key, field, unit.
QUANTITIES = (
    ("stiffness", "stiffness_nm_rad", "N*m/rad"),
    ("damping", "damping_nms_rad", "N*m*s/rad"),
    ("delay", "delay_s", "s"),
    ("window", "window_s", "s"),
)


def servo_as_json(servo: Servo) -> dict[str, Any]:
    """As it is set in the drive. Its limit is none of these: that is a parameter, where it was measured."""
    return {key: {"value": getattr(servo, field), "unit": unit} for key, field, unit in QUANTITIES}


def servo_from_json(path: Path | str, content: object) -> Servo:
    """The reverse. Raises UsageError for what is none."""
    values = {}
    for key, field, _ in QUANTITIES:
        entry = content.get(key) if isinstance(content, dict) else None
        value = entry.get("value") if isinstance(entry, dict) else None
        least = {"window": SHORTEST_WINDOW_S}.get(key, 0.0)
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not isfinite(value) or value < least:
            raise UsageError(f'{path}: servo.{key} needs a positive number under "value", not {value!r}')
        values[field] = float(value)
    servo = Servo(**values)
    if not servo.gain:
        raise UsageError(
            f"{path}: servo.stiffness needs a positive number, or servo.damping where a velocity is commanded"
        )
    return servo
