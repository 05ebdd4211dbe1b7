"""Whether the bench can render a law, found out beside a session in which somebody waits for it."""

from threading import Thread
from typing import TYPE_CHECKING

from norton_bench.errors import ExperimentError
from norton_bench.segments import Admittance

if TYPE_CHECKING:
    from norton_bench.control.calibration import LoadCalibration


class Certifying:
    """Whether the bench can render ``law``, found out beside the session: that may take seconds.

    From a body that the load acts already, ``before``, the laws on the way must be such, too. Once it is ``done``,
    there is a ``certificate``, or it is empty and ``refusal`` says why.
    """

    def __init__(self, calibration: "LoadCalibration", tick_s: float, law: Admittance, before: Admittance | None):
        self.law, self.certificate = law, ""
        self.refusal = f"{law.words}: whether the bench can render it could not be computed"
        self._thread = Thread(target=self._certify, args=(calibration, tick_s, before), daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def _certify(self, calibration: "LoadCalibration", tick_s: float, before: Admittance | None) -> None:
        from norton_bench.control.rendering import (  # noqa: PLC0415  (compiled: slow to import)
            require_change,
            require_rendered,
        )

        try:
            certificate = require_rendered(calibration, tick_s, self.law).words
            if before is not None:
                require_change(calibration, tick_s, before, self.law)
        except ExperimentError as error:
            self.refusal = str(error)
        except Exception as error:  # beside the session nobody else would tell
            self.refusal += f" ({error!r})"
        else:
            self.certificate = certificate
