"""The units of a log in SI: those of its motion, of its exertion, and of what a map gives."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Units:
    """The SI units of a log: those of motion and exertion, and of the command, which keeps its own.

    ``drive`` is the unit of what acts on the motor: volt where the command is the share of a supply.
    """

    motion: str
    exertion: str
    inertia: str
    command: str
    drive: str

    @classmethod
    def of(cls, motion: str, command: str, *, supplied: bool) -> "Units":
        drive = "V" if supplied else command
        if motion == "translation":
            return cls("m", "N", "kg", command, drive)
        return cls("rad", "N*m", "kg*m^2", command, drive)

    @property
    def columns(self) -> Mapping[str, str]:
        """The unit that each column is converted to."""
        return {
            "time": "s",
            "position": self.motion,
            "velocity": f"{self.motion}/s",
            "link_position": self.motion,
            "command": self.command,
            "exertion": self.exertion,
            "goal": self.motion,
            "enabled": "",
            "supply": "V",
            "temperature": "degC",
            "normal": "N",
            "load": self.exertion,
        }

    @property
    def gain(self) -> str:
        """The unit of exertion per drive."""
        return f"{self.exertion}/({self.drive})" if self.drive else self.exertion

    @property
    def link(self) -> Mapping[str, str]:
        """The units of the spring between motor and link."""
        return {"link_stiffness": f"{self.exertion}/{self.motion}", "link_damping": f"{self.exertion}*s/{self.motion}"}

    @property
    def givens(self) -> Mapping[tuple[str, str], str]:
        """The unit of each number that a section may give."""
        command = self.command or "1"
        return {
            ("actuator", "torque_gain"): self.gain,
            ("actuator", "resistance"): "ohm",
            ("actuator", "gear_ratio"): "" if self.motion == "rad" else "rad/m",
            ("load", "inertia"): self.inertia,
            ("load", "gravity"): self.exertion,
            ("load", "gravity_zero"): self.motion,
            ("load", "mass"): "kg",
            ("load", "length"): "m",
            ("loop", "proportional"): f"({command})/{self.motion}",
            ("loop", "derivative"): f"({command})*s/{self.motion}",
            ("loop", "limit"): self.command,
            ("model", "cogging_period"): self.motion,
        }
