"""How far the network's predictions are off, and within what range that was seen."""

import numpy as np

from norton_bench.models.prediction import UNITS
from norton_bench.report.data import ReportData
from norton_bench.report.section import Section
from norton_bench.report.words import number, percent


def model_error_section(data: ReportData) -> Section | None:
    error = data.model_error
    if error is None:
        return None
    prediction = error.prediction
    seen = "; ".join(
        f"{name} {number(low, 3)} to {number(high, 3)} {UNITS.get(name, data.command_unit)}"
        for name, (low, high) in prediction.ranges.items()
    )
    sentences = [
        f"On segments that its values were not fitted to the network is {number(1e3 * error.rms_nm, 2)} mN·m rms off "
        f"beyond the readings' noise of {number(1e3 * error.noise_nm, 2)} mN·m.",
        f"In {percent(prediction.level)} of such stretches the torque's rms error is within "
        f"{number(1e3 * prediction.torque_nm, 2)} mN·m"
        + (
            f" and the free velocity's within {number(prediction.velocity_rad_s, 2)} rad/s; {seen}."
            if np.isfinite(prediction.velocity_rad_s)
            else f"; {seen}."
        ),
    ]
    if np.isfinite(error.zero.moved_nm):
        sentences.append(
            f"The sensor's zero in the fit is {number(1e3 * error.zero.moved_nm, 2)} mN·m above that of the tare."
        )
    if not error.departures and not error.unexplained:
        sentences.append("Nothing that the model lacks was found.")
    return Section("model-error", "The model's own error", tuple(sentences))
