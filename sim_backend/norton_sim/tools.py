"""What the command line may ask of the simulator, found through the entry points ``norton_bench.simulators``."""

from collections.abc import Mapping
from typing import Any

from norton_sim import truth


def true_parameters(
    simulated: Mapping[str, Any],
    *,
    seed: int | None,
    place: str,
    command_unit: str = "N*m",
    modulation_unit: str = "N*m/rad",
) -> dict[str, tuple[float, str]]:
    """The simulated actuator's true parameters, ``{name: (value, unit)}``, under the names the identifier uses.

    Raises WiringError, with place and mend, for true values that are wrong or missing.
    """
    result = truth.read_truth(
        simulated, seed=seed, place=place, command_unit=command_unit, modulation_unit=modulation_unit
    )
    return truth.true_parameters(result, command_unit, modulation_unit)
