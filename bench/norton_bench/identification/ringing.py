"""What readings fold down of the ringing between motor and load, on the torque sensor's spring.

Each step of a command makes both inertias ring. Where they do so near the rate of the readings, or a multiple of it,
the readings show it slowly, in the band that is fitted. How much depends on the damping, which the twist within that
band hardly tells, and on the stiffness; so columns over what both may be stand for it.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from norton_bench.identification.bootstrap import Ringing, Simulation, inertia_of
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.information import Linearised
from norton_bench.identification.residuals.departures import Candidate, Kind
from norton_bench.identification.results import FitResult

# Shares of critical damping: from a single piece of steel's to that of a joint that rubs (Bachmann et al., Vibration
# Problems in Structures, 1995, app. C); what lies between is a sum of some.
RATIOS = (0.01, 0.03, 0.1)
# The stiffness, in deviations from what the calibration tells.
OFF = (-2.0, 0.0, 2.0)


def folded_ringing(simulation: Simulation, result: FitResult) -> tuple[Candidate, ...]:
    """A departure of the readings, over the rows of an expansion; none where no ringing is folded into the band."""
    coupling, at = simulation.readings.coupling, Linearised.at(result)
    if coupling is None:
        return ()
    inertia_kgm2 = inertia_of(simulation.solution)
    resonance_hz = coupling.resonance_hz(inertia_kgm2)
    rate_hz = 1.0 / simulation.torque.period_s
    folded_hz = abs(resonance_hz - round(resonance_hz / rate_hz) * rate_hz)
    if resonance_hz < 0.5 * rate_hz or folded_hz * simulation.readings.tick_s > at.band.cutoff:
        return ()
    ringing = Ringing.of(simulation, coupling)
    columns = [ringing.read(spring, at.band) for spring in _springs(coupling, inertia_kgm2)]
    return ((_kind(resonance_hz, rate_hz), 0, np.stack(columns)),)


def _springs(coupling: Coupling, inertia_kgm2: float) -> Iterator[Coupling]:
    for off, ratio in product(OFF, RATIOS):
        yield coupling.stiffer(off).damped(ratio, inertia_kgm2)


def _kind(resonance_hz: float, rate_hz: float) -> Kind:
    return Kind(
        "ringing",
        "ringing that the torque readings fold down",
        f"motor and load ring on the torque sensor's spring at some {resonance_hz:.0f} Hz, and it is read at "
        f"{rate_hz:.0f} Hz; the motor is not to blame, and a softer or a stiffer sensor would mend that",
        "folded ringing",
    )
