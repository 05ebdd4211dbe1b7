"""The comparison of friction models, and why one with more parameters may fit worse."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from norton_bench.identification.friction.family import CONTAINS
from norton_bench.identification.friction.fit import ROUGHNESS
from norton_bench.identification.friction.laws import EXCESS
from norton_bench.models.parameters import UNITS
from norton_bench.report.section import Facts, Section
from norton_bench.report.words import number, percent, pretty_unit
from norton_bench.result import Result

# The assumption of each model whose torque depends on the path.
ASSUMES = {
    "dahl": "yields from the first motion on",
    "elasto-plastic": "is purely elastic up to breakaway, and then yields along one fixed curve",
    "lugre": f"yields from the first motion on, with stiction at least {100 * EXCESS.low:.0f} % above Coulomb friction",
    "maxwell-slip": "is a sum of elements that each yield all at once, without damping before sliding",
}
WITHOUT_MEMORY = "depends on the velocity alone, not on the path"


class Compared(Protocol):
    """One model of the comparison."""

    @property
    def name(self) -> str: ...

    @property
    def unknowns(self) -> int: ...

    @property
    def train_relative(self) -> float: ...


def friction_section(data: Result) -> Section | None:
    """How much of the torque each friction model leaves, on data that it was fitted to and on data that it was not."""
    if not data.ladder:
        return None
    best = next(rung for rung in data.ladder if rung.selected)
    sentences = (
        "Which friction law describes this actuator? Each model was fitted to most of the recording and judged on "
        "the rest, in turns, at low frequencies.",
        f"Selected is {best.name}: the model with the fewest numbers whose error on the parts not fitted is within "
        "one standard error of the smallest.",
        "Errors are rms, as a share of the torque's rms.",
    )
    head = ("model", "numbers", "error, fitted data [%]", "error, other data [%]", "standard error [%]", "remark")
    rows = tuple(
        (
            rung.name,
            str(rung.unknowns),
            number(100 * rung.train_relative, 3),
            number(100 * rung.held_out_relative, 3),
            number(100 * rung.held_out_std / rung.target_rms, 3),
            "selected" if rung.selected else "" if rung.fit.converged else "did not converge",
        )
        for rung in data.ladder
    )
    why, laws = worse_though_richer(best, data.ladder)
    return Section(
        "friction", "Comparison of friction models", (*sentences, *why), tables=(Facts(head, rows),), points=laws
    )


def worse_though_richer(best: Compared, models: Sequence[Compared]) -> tuple[list[str], tuple[str, ...]]:
    """Why models with more parameters than ``best`` fit worse, even the data that they were fitted to.

    Sentences, and a line for each of the friction laws that are others.
    """
    tolerance = best.train_relative * (1 + ROUGHNESS)
    richer = [each for each in models if each.unknowns > best.unknowns and each.train_relative > tolerance]
    others = [each.name for each in richer if best.name not in CONTAINS.get(each.name, ())]
    sentences = []
    if others:
        one = len(others) == 1
        law, of = ("is another friction law", "an extension") if one else ("are other friction laws", "extensions")
        sentences.append(
            f"More numbers need not fit better, even on the data fitted: {_listed(others)} {law}, not {of} of "
            f"{best.name}, and cannot become {best.name} for any values."
        )
    laws = (f"{name} {ASSUMES.get(name.removesuffix('-asymmetric'), WITHOUT_MEMORY)}." for name in others)
    return sentences, tuple(laws)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def model_error_section(data: Result) -> Section | None:
    """The error of the network's predictions, and the range in which it was tested."""
    error = data.model_error
    if error is None:
        return None
    prediction = error.prediction
    seen = "; ".join(
        f"{name} {number(low, 3)} to {number(high, 3)} {pretty_unit(UNITS.get(name, data.command_unit))}"
        for name, (low, high) in prediction.ranges.items()
    )
    velocity = (
        f" and of the free velocity below {number(prediction.velocity_rad_s, 2)} rad/s"
        if np.isfinite(prediction.velocity_rad_s)
        else ""
    )
    sentences = [
        f"On parts of the recording that were kept apart from the fit, the model's own error is "
        f"{number(1e3 * error.rms_nm, 2)} mN·m rms; the noise of the readings ({number(1e3 * error.noise_nm, 2)} mN·m) "
        "is not counted.",
        f"In {percent(prediction.level)} of stretches of such motion the rms error of the torque is below "
        f"{number(1e3 * prediction.torque_nm, 2)} mN·m{velocity}.",
        f"This was tested for: {seen}. Outside this range nothing was tested.",
    ]
    if np.isfinite(error.zero.moved_nm):
        sentences.append(
            f"The fit finds the torque sensor's zero {number(1e3 * error.zero.moved_nm, 2)} mN·m from that of the tare."
        )
    if not error.departures and not error.unexplained:
        sentences.append("No effect was found that the model lacks.")
    return Section("model-error", "How accurate predictions are", tuple(sentences))
