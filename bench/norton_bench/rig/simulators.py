"""The simulator's own tools, found by their entry points so that the bench never knows it."""

from typing import Any

from norton_bench.rig.rig import Rig
from norton_drivers import registry

SIMULATORS = "norton_bench.simulators"


def simulator(name: str) -> Any:
    """One of them. Raises WiringError where it is not installed."""
    return registry.load(SIMULATORS, name, asked_by="the simulator's part")


def true_parameters(rig: Rig, seed: int | None = None) -> dict[str, tuple[float, str]]:
    """The simulated actuator's true parameters, ``{name: (value, unit)}``, under the names the identifier uses.

    Raises WiringError, with place and mend, for true values that are wrong or missing.
    """
    found: dict[str, tuple[float, str]] = simulator("true_parameters")(
        rig.simulated,
        seed=seed,
        place=rig.place,
        command_unit=rig.command.unit,
        modulation_unit=rig.wiring.modulation_unit,
    )
    return found
