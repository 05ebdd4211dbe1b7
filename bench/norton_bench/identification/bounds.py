"""Values that no motor has: what becomes of estimates beyond their bounds, and of the network with them."""

from dataclasses import replace

from norton_bench.identification.results import FitResult
from norton_bench.models.network import PARAMETER_OF_FIELD, NortonNetwork, impossible
from norton_bench.models.parameters import Estimate, Status

WITHIN = 1.96  # deviations, of 95 %


def beyond_bounds(network: NortonNetwork) -> tuple[str, ...]:
    """Parameters, by their names, whose values no network file may have."""
    values = {name: getattr(network, field) for field, name in PARAMETER_OF_FIELD.items()}
    return tuple(name for name, value in values.items() if value is not None and impossible(name, value))


def possible(result: FitResult) -> FitResult:
    """The same, with presliding damping no less than none in the network; and said so.

    The estimate keeps its number: zero lies within its interval, or it is at its bound. What else is below zero leaves
    no network that could be used.
    """
    beyond = beyond_bounds(result.network)
    if not beyond:
        return result
    sentences, network = [], result.network
    if "presliding_damping" in beyond:
        network = replace(network, presliding_damping_nms_rad=0.0)
        sentences.append("Presliding damping comes out below zero: the network has none.")
    others = [name.replace("_", " ") for name in beyond if name != "presliding_damping"]
    if others and not result.doubtful:
        sentences.append(f"No network is written, because no machine has values below zero: {', '.join(others)}.")
    estimates = tuple(_bounded(each) if each.name in beyond else each for each in result.estimates)
    return replace(result, network=network, estimates=estimates, verdict=(*result.verdict, *sentences))


def _bounded(estimate: Estimate) -> Estimate:
    """At its bound where even its interval lies below it, not excited where it does not."""
    if estimate.status is not Status.VALID:
        return estimate
    below = estimate.value < -WITHIN * estimate.std
    return replace(estimate, status=Status.AT_BOUND if below else Status.UNEXCITED)
