"""How far an in-situ experiment has come."""

from dataclasses import dataclass, field

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.in_situ import Exerted, LoadTaken
from norton_bench.procedures.learning import Correction, Models


@dataclass(frozen=True, eq=False)
class Assembly:
    """Both machines, and in sentences where the load's values come from."""

    models: Models
    said: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class InSitu:
    """How far it has come. ``order`` says of each trial to come, and of those that were, whether it is driven."""

    assembly: Assembly | None = None
    command: FloatArray = field(default_factory=lambda: np.empty(0))
    order: tuple[bool, ...] = ()
    trials: tuple[Exerted, ...] = ()
    corrections: tuple[Correction, ...] = ()
    finished: bool = False

    @property
    def load(self) -> LoadTaken:
        """What the recording must tell of the load; asked for once the assembly was shaken."""
        assert self.assembly is not None
        return LoadTaken(self.assembly.models.load, self.assembly.said, len(self.command))
