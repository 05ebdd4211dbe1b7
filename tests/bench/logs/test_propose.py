"""A map proposed from names, units and mechanics is the one that the log was written by."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.logs.column_map import ColumnMap, parse_map
from norton_bench.logs.column_names import kind_of_column, unit_in_name
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.propose import propose, write_proposal
from tests.bench.logs.machines import Columns, Machine, column_map, estimate, write_csv

LOG = Machine(duration_s=6.0, rate_hz=200.0).log()


def proposed(folder: Path, columns: Columns) -> tuple[ColumnMap, str]:
    """The map of a log with these columns, and what was said."""
    text, sentences = propose(write_csv(folder / "log.csv", columns))
    return parse_map(text, place="proposed"), " ".join(sentences)


def test_units_and_signs_that_no_name_tells_follow_from_mechanics(tmp_path: Path) -> None:
    columns = {"time_ms": 1e3 * LOG["t"], "angle": LOG["q"], "speed": -np.rad2deg(LOG["w"]), "current [A]": -LOG["u"]}
    found, said = proposed(tmp_path, columns)
    assert found.columns.time is not None
    assert found.columns.time.unit == "ms"
    assert found.columns.position is not None
    assert found.columns.position.unit == "rad"
    assert found.columns.velocity is not None
    assert (found.columns.velocity.unit, found.columns.velocity.sign) == ("deg/s", -1)
    assert found.columns.command is not None
    assert (found.columns.command.unit, found.columns.command.sign) == ("A", -1)
    assert "57.3 times the derivative" in said
    assert "the sign of the command" in said


def test_what_is_assumed_is_said(tmp_path: Path) -> None:
    found, said = proposed(tmp_path, {"t": LOG["t"], "q": LOG["q"], "u2": LOG["u2"], "tau": LOG["tau"]})
    assert found.columns.exertion is not None
    assert (found.columns.exertion.unit, found.columns.exertion.sign) == ("N*m", 1)
    for assumed in ('"t" is taken to be in s', '"q" is taken to be in rad', '"tau" is taken to be in N*m'):
        assert assumed in said


def test_a_slide_is_known_by_its_units(tmp_path: Path) -> None:
    columns = {"t": LOG["t"], "position [mm]": 1e3 * LOG["q"], "voltage_v": LOG["u"], "force": LOG["tau"]}
    found, _ = proposed(tmp_path, columns)
    assert found.translation
    assert found.columns.exertion is not None
    assert found.columns.exertion.unit == "N"


def test_a_velocity_that_is_none_is_left_out_and_a_second_joint_named(tmp_path: Path) -> None:
    noise = np.random.default_rng(41).standard_normal(LOG["t"].size)
    columns = {"t": LOG["t"], "q1": LOG["q"], "q2": LOG["w"], "vel": noise, "u1": LOG["u"]}
    found, said = proposed(tmp_path, columns)
    assert found.columns.velocity is None
    assert '"vel" is not the derivative of "q1"' in said
    assert '"q2" may be the position too' in said


@pytest.mark.parametrize(
    ("name", "what", "unit"),
    [
        ("t_s", "time", "s"),
        ("cur_A", "command", "A"),
        ("angle_rev", "position", "rev"),
        ("torque_mNm", "exertion", "mN*m"),
        ("F", "exertion", ""),
        ("tau_m", "exertion", ""),
        ("Carriage Pos", "position", ""),
        ("speed_deg_s", "velocity", "deg/s"),
    ],
)
def test_short_names_with_their_units(name: str, what: str, unit: str) -> None:
    assert kind_of_column(name) == what
    assert unit_in_name(what, name, "") == unit


@pytest.mark.parametrize(("known", "unit"), [("angle [deg]", "deg/s"), ("angle [rev]", "rpm")])
def test_the_unit_of_one_tells_that_of_the_other(tmp_path: Path, known: str, unit: str) -> None:
    per = {"deg/s": 180 / np.pi, "rpm": 30 / np.pi}[unit]
    place = {"angle [deg]": 180 / np.pi, "angle [rev]": 0.5 / np.pi}[known]
    columns = {"t [s]": LOG["t"], known: place * LOG["q"], "speed": per * LOG["w"], "current [A]": LOG["u"]}
    found, _ = proposed(tmp_path, columns)
    assert found.columns.velocity is not None
    assert found.columns.velocity.unit == unit


def test_a_voltage_is_in_volts_and_the_word_sample_is_no_time(tmp_path: Path) -> None:
    log = {"time_s": LOG["t"], "angle_rev": LOG["q"] / (2 * np.pi), "motor_voltage": LOG["u"]}
    text, said = propose(write_csv(tmp_path / "log.csv", log))
    assert 'command = { name = "motor_voltage", unit = "V" }' in text
    assert 'position = { name = "angle_rev", unit = "rev" }' in text
    assert any('"motor_voltage" is taken to be in V' in each for each in said)
    counted = {"Sample": np.arange(LOG["t"].size, dtype=float), "angle_rev": LOG["q"], "cur_A": LOG["u"]}
    with pytest.raises(UsageError, match=r'\[log\] rate = "1 kHz"'):
        propose(write_csv(tmp_path / "counted.csv", counted))


@pytest.mark.parametrize("columns", [{"a": LOG["t"], "b": LOG["q"]}, {"t": LOG["t"], "q": LOG["q"]}])
def test_names_that_tell_nothing_are_refused_with_those_that_there_are(tmp_path: Path, columns: Columns) -> None:
    with pytest.raises(UsageError, match="no column can be told by its name to be") as raised:
        propose(write_csv(tmp_path / "log.csv", columns))
    assert "there are" in str(raised.value)


def test_a_proposal_that_is_there_is_not_written_over(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", LOG)
    path, _ = write_proposal(log, None)
    path.write_text("mended")
    with pytest.raises(UsageError, match="is there already"):
        write_proposal(log, None)
    assert path.read_text() == "mended"


@pytest.mark.long
def test_the_log_of_the_five_minutes_gives_the_values_that_the_docs_show() -> None:
    root = Path(__file__).parents[3]
    path, docs = root / "examples" / "logs" / "joint.csv", (root / "docs" / "logs.md").read_text()
    text, said = propose(path)
    shown = text.partition("[log]")[2]
    assert f"[log]{shown}" in docs
    assert any("sign of the command" in each for each in said)
    fit = fit_logs(Request((path,), parse_map(f'{text}torque_gain = "0.8 N*m/A"\n', place="proposed"), test="10: s"))
    assert fit.model == "coulomb-viscous"
    for name, true in (("inertia", 0.02), ("viscous_damping", 0.15), ("coulomb_torque", 0.1)):
        assert estimate(fit, name).value == pytest.approx(true, rel=0.01)
        assert f"| {estimate(fit, name).value:.5g} |" in docs


def test_joints_by_number_have_no_unit_in_their_brackets(tmp_path: Path) -> None:
    one, other = LOG, Machine(duration_s=6.0, rate_hz=200.0, inertia=0.1, seed=2).log()
    columns = {"time": one["t"]}
    for index, log in enumerate((one, other)):
        columns |= {f"position[{index}]": log["q"], f"velocity[{index}]": log["w"], f"effort[{index}]": 2 * log["u"]}
    path = write_csv(tmp_path / "log.csv", columns)
    text, _ = propose(path, "1")
    assert 'name = "position[{joint}]", unit = "rad"' in text
    assert 'command = { name = "effort[{joint}]", unit = "N*m" }' in text


@pytest.mark.parametrize("name", ["/battery/voltage", "v_bus", "bus_voltage", "supply_voltage"])
def test_what_feeds_a_drive_is_no_command(name: str) -> None:
    assert kind_of_column(name) is None


def test_stamps_too_coarse_to_differ_are_said_to_be_the_same(tmp_path: Path) -> None:
    log = LOG
    path = write_csv(tmp_path / "log.csv", {"time": 0 * log["t"], "pos_rad": log["q"], "vel": log["w"], "iq": log["u"]})
    text, _ = propose(path)
    with pytest.raises(UsageError, match="have the same time as the row before"):
        fit_logs(Request((path,), column_map(text)))


def test_a_column_that_holds_a_word_is_named_with_its_row(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", {"time": LOG["t"], "pos_rad": LOG["q"], "torque [Nm]": LOG["u"]})
    lines = path.read_text().splitlines()
    lines[501] = lines[501].rsplit(",", 1)[0] + ",ERR"
    path.write_text("\n".join(lines))
    with pytest.raises(UsageError, match=r"is a command or exertion; \"torque \[Nm\]\" .* row 501"):
        propose(path)


def test_a_torque_that_drives_the_motion_is_that_of_the_drive(tmp_path: Path) -> None:
    """Nothing else is a command: its gain is 1, and no sign is turned. What brakes is measured at the port."""
    torque = 2.0 * LOG["u"]
    drives, said = proposed(tmp_path, {"t": LOG["t"], "q": LOG["q"], "Motor torque (Nm)": torque})
    assert drives.columns.exertion is None
    assert drives.columns.command is not None
    assert (drives.columns.command.unit, drives.columns.command.sign) == ("N*m", 1)
    assert drives.actuator.torque_gain is not None
    assert '"Motor torque (Nm)" drives the motion' in said
    brakes, _ = proposed(tmp_path, {"t": LOG["t"], "q": LOG["q"], "tau [Nm]": -torque})
    assert brakes.columns.exertion is not None
    assert brakes.columns.exertion.sign == 1
