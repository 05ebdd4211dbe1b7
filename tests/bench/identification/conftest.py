"""One experiment, simulated once for all tests of a module run."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.judged_fit import fit
from tests.bench.identification import synthetic
from tests.bench.once import once


@pytest.fixture(scope="session")
def experiment():
    return synthetic.experiment(1)


@pytest.fixture(scope="session")
def result(experiment, tmp_path_factory):
    return once(
        tmp_path_factory,
        "result of the experiment",
        lambda _folder: fit(experiment, command_unit="N*m", tick_s=synthetic.TICK_S),
    )


@pytest.fixture(scope="session")
def without_torque(experiment):
    return replace(experiment, torque=experiment.torque[:0])


def truth_of(factors):
    return synthetic.Truth(*(synthetic.Truth().array() * np.asarray(factors)))
