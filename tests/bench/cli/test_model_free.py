"""The JSON of what was found without a model."""

import json

import numpy as np

from norton_bench.cli.output import to_json
from norton_bench.cli.results import model_free, residual_figures
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.residual_tests import Dependence, Harmonic, Memory, ResidualTests
from norton_bench.identification.results import SourceMap
from norton_bench.identification.without_model import Prediction, StopOperator, WithoutModel

LEVELS = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
VELOCITY = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])


def printed(data: object) -> dict:
    return json.loads(to_json(data))


def test_the_documented_shape() -> None:
    port_nm = np.full(5, 1e-4)
    source = SourceMap(
        LEVELS, VELOCITY, np.full(5, 0.1), np.ones(5, bool), np.tile(VELOCITY, (9, 1)), 0.05, port_nm, 0.5 * port_nm
    )
    table = ImpedanceTable(
        LEVELS[:2], VELOCITY[:2], np.array([[1.0, np.nan], [2.0, 3.0]]), np.ones((2, 2)), np.ones((2, 2))
    )
    operator = StopOperator(np.ones(14), np.ones((2, 14)), np.zeros((2, 14)), 5e-5, 1e-3, np.ones(20))
    found = WithoutModel(table, operator, operator_prediction=Prediction(1e-3, 0.02, 1.0))
    data = printed(model_free(source, found))
    assert data["source"]["dead_zone"]["rising"]["width"] == 1.0
    assert data["source"]["dead_zone"]["falling"] is None
    assert data["source"]["hysteresis"] is None
    assert data["source"]["low_rad_s"] == VELOCITY.tolist()
    assert data["source"]["port_torque_nm"] == [1e-4] * 5
    assert data["source"]["port_torque_std_nm"] == [5e-5] * 5
    assert data["table"]["torque_nm"] == [[1.0, None], [2.0, 3.0]]
    assert data["table"]["empty_cells"] == 1
    assert data["operator"]["abrupt_share"] == 0.5
    assert data["predicted"] == {
        "operator": {"torque_rms_nm": 1e-3, "torque_relative": 0.02, "share": 1.0},
        "stops_alone": None,
        "table": None,
    }


def test_a_source_alone_will_do_and_its_band_may_be_unknown() -> None:
    data = printed(model_free(SourceMap(LEVELS, VELOCITY, np.full(5, 0.1), np.ones(5, bool)), None))
    assert data["source"]["high_rad_s"] == [None] * 5
    assert data["table"] is None
    assert data["predicted"]["operator"] is None


def test_nothing_measured_is_null() -> None:
    assert model_free(None, None) is None
    assert residual_figures(None) is None


def test_what_the_residual_follows() -> None:
    lags = np.arange(3.0)
    memory = Memory(lags, np.array([0.1, -0.2, 0.0]), lags, 0.03)
    followed = Dependence("velocity", lags, lags, lags, 0.5, 0.0, 0.0, np.nan)
    tests = ResidualTests(1e-3, memory, (followed,), (Harmonic(42, 3e-4, 1e-9),), lags)
    data = printed(residual_figures(tests))
    assert data["greatest_autocorrelation"] == 0.2
    assert data["inputs"] == {"velocity": {"p": 0.5, "share": 0.0, "rms_nm": 0.0, "peak_hz": None}}
    assert data["position"] == [{"periods_per_turn": 42, "amplitude_nm": 3e-4, "p": 1e-9}]
