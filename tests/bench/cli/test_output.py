"""What the command line prints: JSON for programs, tables for people."""

import json
from dataclasses import replace
from io import StringIO
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console, Group, RenderableType

from norton_bench.cli.output import Output, plain_table, to_json
from norton_bench.cli.results import identification, parameter_table, summary, with_digits
from norton_bench.identification.departures import STRIBECK, Departure
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.model_error import ModelError, Zero
from norton_bench.identification.rendered import Rendered
from norton_bench.identification.results import FitResult, Trace, Validation
from norton_bench.identification.trials import TrialFigures
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, PredictionError, Status
from norton_bench.report.facts_tables import in_situ_sentence, rendered_sentence, trials_sentence
from norton_bench.result import Result
from norton_bench.segments import Admittance

TRACE = Trace(np.zeros(1), np.zeros(1), np.zeros(1), "N*m")
VALIDATION = Validation(1.5e-3, 0.012, 0.2, 0.034, TRACE, TRACE, 0.05)
MODEL_ERROR = ModelError(
    rms_nm=1.6e-3,
    noise_nm=6e-4,
    left_nm=7e-5,
    departures=(Departure(STRIBECK, 1.6e-3, 0.88, 6e-4, 1e-48, np.zeros(7)),),
    spread=np.zeros(7),
    zero=Zero(3.1e-3, 3e-3, 2e-5),
    prediction=PredictionError(2e-3, nan, 0.95, {"velocity": (-50.0, 50.0), "command": (-0.08, 0.08)}),
)
ESTIMATES = (
    Estimate("torque_gain", 0.9004, 0.0012, "N*m/(N*m)", Status.VALID),
    Estimate("inertia", 5.003e-5, 1.2e-7, "kg*m^2", Status.VALID),
    Estimate("presliding_damping", nan, nan, "N*m*s/rad", Status.UNEXCITED),
)


@pytest.fixture
def fit() -> FitResult:
    network = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")
    verdict = ("free motion tells ratios",)
    return FitResult(ESTIMATES, network, True, 1e-3, 0.01, 1000, 0.0, 0.0, 0.0, 0.0, TRACE, verdict=verdict)


def shown(renderable: RenderableType) -> str:
    console = Console(width=100, record=True, file=StringIO())
    console.print(renderable)
    return console.export_text()


FILES = (Path("runs/a/r.mcap"), Path("runs/a/r.network.json"), Path("runs/a/r.report.html"))


def result_of(fit: FitResult) -> Result:
    return Result(
        "sim",
        metadata={"command_unit": "N*m"},
        recording=FILES[0],
        fit=fit,
        validation=VALIDATION,
        network_file=FILES[1],
        report_file=FILES[2],
    )


def test_json_has_the_documented_shape(fit: FitResult) -> None:
    data = json.loads(to_json(identification(result_of(fit))))
    assert data["parameters"]["torque_gain"] == {
        "value": 0.9004,
        "std": 0.0012,
        "unit": "N*m/(N*m)",
        "status": "valid",
    }
    assert data["parameters"]["presliding_damping"]["value"] is None  # JSON knows no NaN
    assert data["parameters"]["presliding_damping"]["status"] == "unexcited"
    assert data["validation"] == {
        "torque_rms_nm": 1.5e-3,
        "torque_relative": 0.012,
        "velocity_rms_rad_s": 0.2,
        "velocity_relative": 0.034,
        "velocity_noise_rad_s": 0.05,
    }
    assert data["model_error"] is None
    assert data["verdict"] == ["free motion tells ratios"]
    assert data["converged"] is True
    assert (data["recording"], data["network"], data["report"]) == tuple(map(str, FILES))


def test_the_models_error_is_told_to_programs_and_people(fit: FitResult) -> None:
    found = replace(result_of(fit), model_error=MODEL_ERROR)
    told = json.loads(to_json(identification(found)))["model_error"]
    assert (told["torque_nm"], told["velocity_rad_s"], told["level"]) == (2e-3, None, 0.95)
    assert told["ranges"]["command"] == [-0.08, 0.08]
    assert told["zero_less_tare_nm"] == pytest.approx(1e-4)
    assert told["departures"][0]["cause"] == "stribeck"
    assert told["departures"][0]["periods_per_turn"] is None
    said = " ".join(shown(summary(found)).split())
    assert "right 95% of the time to: torque within 0.002 N*m rms; velocity -50 to 50 rad/s, command" in said
    assert "free velocity to 0.2 rad/s rms (3.4% of it; the noise of the readings is 0.05 rad/s" in said


def test_json_of_a_session_that_told_nothing() -> None:
    data = json.loads(to_json(identification(Result("sim"))))
    assert data["parameters"] == {}
    assert data["validation"] is data["network"] is data["report"] is None


def test_a_repeated_movement_has_its_figures_and_a_sentence() -> None:
    trials = tuple(TrialFigures(n, torque, 2.9e-4, 1.5e-4) for n, torque in enumerate((1e-2, 3e-4, 3e-4, 3e-4), 1))
    found = identification(Result("sim", trials=trials))["trials"]
    assert found["converged"]
    assert found["below_first_db"] == pytest.approx(36.5, abs=0.1)
    assert found["with_noise_nm"] == [1e-2, 3e-4, 3e-4, 3e-4]
    assert found["torque_nm"][0] == pytest.approx(1e-2, rel=1e-3)
    said = trials_sentence(trials)
    assert "0.30 mN·m at the port, at least 36 dB below the undriven load" in said
    assert said.endswith("noise hides what is left.")
    assert trials_sentence(trials[:2]).endswith("not converged.")


def test_a_rendered_law_has_its_figures_and_a_sentence() -> None:
    law = Rendered(Admittance(5e-4, 2e-2), (4.9e-4, 2.04e-2, 1e-3), (2e-5, 3e-4, 2e-3), 1.2e-2, 1.1e-3, 8e-4)
    (data,) = identification(Result("sim", rendered=(law,)))["rendered"]
    assert data["asked"] == {"mass_kgm2": 5e-4, "damping_nms_rad": 2e-2, "stiffness_nm_rad": 0.0, "wall_rad": None}
    wall = replace(law, asked=Admittance(5e-4, 2e-2, 2.0, wall_rad=0.1))
    assert "(2.00 beyond 0.100 rad asked for)" in rendered_sentence(wall)
    assert data["measured"]["damping_nms_rad"] == 2.04e-2
    assert data["half_interval"]["mass_kgm2"] == 2e-5
    short = replace(law, shortcoming="the law acted for 1.0 s, and 3 s are needed")
    assert rendered_sentence(short).endswith(
        "asked for; not measured, because the law acted for 1.0 s, and 3 s are needed."
    )
    assert (data["torque_nm"], data["off_nm"], data["left_nm"]) == (1.2e-2, 1.1e-3, 8e-4)
    assert rendered_sentence(law) == (
        "Rendered: mass 0.49 ± 0.02 g·m² (0.500 asked for), damping 20.4 ± 0.3 mN·m·s/rad (20.0 asked for), stiffness "
        "0.001 ± 0.002 N·m/rad (0 asked for); of 12 mN·m rms at the port the law asked for leaves 1.1 unexplained."
    )


def test_an_assembled_actuator_has_its_trials_and_the_file_of_its_source() -> None:
    trials = tuple(TrialFigures(n, torque, 1e-4, 1e-4, torque < 1e-3) for n, torque in enumerate((1e-2, 2e-4, 1e-2), 1))
    found = InSituResult(trials, None, ("the load's inertia is known",), ("after 3 trials there was still more",))
    data = identification(Result("sim", in_situ=found, motion_file=FILES[1]))["in_situ"]
    assert data["driven"] == [False, True, False]
    assert data["below_first_db"] == pytest.approx(35.2, abs=0.1)
    assert data["reasons"] == ["after 3 trials there was still more"]
    assert (data["converged"], data["source"], data["source_scatter_rad_s"]) == (False, FILES[1], None)
    assert "exerted 0.20 mN·m, at least 35 dB below the first; after 3" in in_situ_sentence(found)


def test_the_summary_names_parameters_verdict_and_files(fit: FitResult) -> None:
    text = shown(summary(result_of(fit)))
    row = next(line for line in text.splitlines() if "inertia" in line)
    # Half of a 95 % interval: 1.96 times the deviation of 1.2e-7.
    assert row.split() == ["Im", "inertia", "5.003e-5", "0.024e-5", "kg*m^2", "valid"]
    assert "± (95 %)" in text
    assert "Km·Ka" in text
    assert "free motion tells ratios" in text
    assert "1.2%" in text
    assert all(str(path) in text for path in FILES)


def test_a_table_of_nothing_has_its_headings() -> None:
    assert "parameter" in shown(parameter_table(()))


@pytest.mark.parametrize(
    ("value", "std", "written"),
    [
        (0.90042, 0.0012, ("0.9004", "0.0012")),
        (600.4, 12.0, ("600", "12")),
        (12.345, 0.5, ("12.35", "0.50")),
        (5.0031e-5, 1.2e-7, ("5.003e-5", "0.012e-5")),
        (-2.5e6, 1e4, ("-2.500e6", "0.010e6")),
        (0.0, 0.1, ("0.00", "0.10")),
        (1.0, inf, ("1", "–")),
        (1.0, 0.0, ("1", "–")),
        (nan, 1.0, ("–", "–")),
    ],
)
def test_digits_follow_the_deviation(value: float, std: float, written: tuple[str, str]) -> None:
    assert with_digits(value, std) == written


@given(st.floats(-1e9, 1e9), st.floats(1e-9, 1e3))
def test_what_is_written_is_true_within_a_tenth_of_the_deviation(value: float, relative: float) -> None:
    std = max(abs(value), 1e-9) * relative
    written, deviation = with_digits(value, std)
    assert abs(float(written) - value) <= 0.051 * std
    assert abs(float(deviation) - std) <= 0.051 * std


@pytest.mark.long
@given(
    st.recursive(
        st.floats() | st.text() | st.integers(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)
    )
)
def test_any_result_is_strict_json(data: object) -> None:
    """NaN and infinity, which JSON does not know, would end in ``pytest.fail``."""
    json.loads(to_json(data), parse_constant=pytest.fail)


def test_data_go_to_stdout_and_remarks_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    output = Output(json=True)
    output.say("working")
    output.result({"a": 1}, "for people")
    streams = capsys.readouterr()
    assert json.loads(streams.out) == {"a": 1}
    assert streams.err == "working\n"


def test_tables_are_whole_however_narrow_the_page(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    table = plain_table()
    for place in range(12):
        table.add_column(f"heading {place}", no_wrap=True)
    table.add_row(*(f"1.2345678e-{place}" for place in range(12)))
    Output().result({}, Group(table, "and a word"))
    head, row, word = capsys.readouterr().out.splitlines()
    assert head.endswith("heading 11")
    assert row.split() == [f"1.2345678e-{place}" for place in range(12)]
    assert word == "and a word"


def test_people_get_the_words_unbroken(capsys: pytest.CaptureFixture[str]) -> None:
    path = "/a/very/long/path/" + "x" * 200
    Output(quiet=True).result({}, path)
    Output(quiet=True).say("never heard")
    streams = capsys.readouterr()
    assert streams.out == f"{path}\n"
    assert streams.err == ""
