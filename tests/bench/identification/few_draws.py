"""A recording judged as a session concludes it, with few simulated records."""

from functools import partial

import pytest

from norton_bench.identification import judged_fit
from norton_bench.identification.bootstrap import Readings
from norton_bench.identification.cleaning import clean
from norton_bench.identification.judged_fit import JudgedFit, fit_judged
from norton_bench.records import Measured
from tests.bench.identification.synthetic import TICK_S

# Records simulated for the deviations: with so few, Student's distribution makes them wide.
DRAWS = 4


def judged_with_few_draws(measured: Measured) -> JudgedFit:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judged_fit, "Readings", partial(Readings, draws=DRAWS))
        return fit_judged(clean(measured), command_unit="N*m", tick_s=TICK_S)
