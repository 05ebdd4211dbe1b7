"""What an in-situ experiment took its load for: the one thing in its recording that its trials alone do not tell."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from norton_bench.errors import ExperimentError
from norton_bench.identification.machine import Machine
from norton_bench.models.network import REQUIRED, NortonNetwork
from norton_bench.records import LOAD_TAKEN, Event


@dataclass(frozen=True)
class LoadTaken:
    """The load's values, in sentences where they come from, and how many ticks a trial is to have."""

    machine: Machine
    said: tuple[str, ...]
    ticks: int

    def as_text(self) -> str:
        """For an event; :meth:`of_text` reads it to the last digit."""
        network = self.machine.network
        return json.dumps(
            {
                "network": {name: getattr(network, name) for name in (*REQUIRED, "command_unit")},
                "command_delay_s": self.machine.command_delay_s,
                "motion_delay_s": self.machine.motion_delay_s,
                "said": self.said,
                "ticks": self.ticks,
            },
            ensure_ascii=False,
        )

    @classmethod
    def of_text(cls, text: str) -> "LoadTaken":
        """Raises ExperimentError for what :meth:`as_text` has not written."""
        try:
            data: dict[str, Any] = json.loads(text)
            network = NortonNetwork(**data["network"])
            machine = Machine(network, data["command_delay_s"], data["motion_delay_s"])
            return cls(machine, tuple(data["said"]), int(data["ticks"]))
        except (ValueError, KeyError, TypeError) as error:
            raise ExperimentError(f"what the load was taken for cannot be read: {error!r}") from error


def load_taken(events: Sequence[Event]) -> LoadTaken | None:
    """What was said last; None where nothing was."""
    said = [event.text for event in events if event.kind == LOAD_TAKEN]
    return LoadTaken.of_text(said[-1]) if said else None
