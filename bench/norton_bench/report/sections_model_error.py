"""How far the network's predictions are off, and within what range that was seen."""

import numpy as np

from norton_bench.models.parameters import UNITS
from norton_bench.report.data import ReportData
from norton_bench.report.section import Section
from norton_bench.report.words import number, percent, pretty_unit


def model_error_section(data: ReportData) -> Section | None:
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
