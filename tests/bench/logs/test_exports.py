"""Tables that PlotJuggler and Foxglove write, and others whose columns were sampled apart."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.logs.column_map import LogSection
from norton_bench.logs.files import read_file
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.log import read_log
from tests.bench.logs.bags import TRUE, moved
from tests.bench.logs.machines import column_map, estimate, write_csv

MAP = """
[log]
motion = "rotation"
[columns]
time = {{ name = "{time}", unit = "s" }}
position = {{ name = "{position}", unit = "rad" }}
exertion = {{ name = "{exertion}", unit = "N*m" }}
[model]
candidates = ["coulomb-viscous"]
delays = false
"""
EPOCH_S = 1_772_000_000.0


def series() -> Mapping[str, tuple[FloatArray, FloatArray]]:
    """The elbow and the torque that moves it, each at times of its own."""
    time_s, position, _ = moved("elbow")
    torque_s = np.arange(int(time_s[-1] * 400)) / 400 + 0.0004
    return {
        "/joint_states/elbow/position": (time_s, position),
        "/wrench/torque/z": (torque_s, -TRUE["elbow"].force(torque_s)),
    }


def check_elbow(path: Path, text: str) -> None:
    fit = fit_logs(Request((path,), column_map(text)))
    assert estimate(fit, "inertia").value == pytest.approx(TRUE["elbow"].inertia, rel=0.03)
    assert estimate(fit, "coulomb_torque").value == pytest.approx(TRUE["elbow"].coulomb, rel=0.05)
    assert any("has other times than position" in said for said in fit.verdict)


def test_plotjugglers_table_in_which_every_row_has_what_came_then(tmp_path: Path) -> None:
    rows = sorted(
        (t, index, value)
        for index, (times, values) in enumerate(series().values())
        for t, value in zip(times, values, strict=True)
    )
    lines = [f"{EPOCH_S + t:.6f},{',' * index}{value:.9f}{',' * (1 - index)}" for t, index, value in rows]
    path = tmp_path / "elbow.csv"
    path.write_text("\n".join([",".join(["__time", *series()]), *lines]))
    check_elbow(path, MAP.format(time="__time", position="/joint_states/elbow/position", exertion="/wrench/torque/z"))


def test_foxgloves_table_with_one_value_a_row(tmp_path: Path) -> None:
    rows = sorted(
        (t, name, value) for name, (times, values) in series().items() for t, value in zip(times, values, strict=True)
    )
    lines = [f"{t:.6f},{EPOCH_S + t + 0.002:.6f},{EPOCH_S + t:.6f},{name},{value:.9f}" for t, name, value in rows]
    path = tmp_path / "elbow.csv"
    path.write_text("\n".join(["elapsed time,receive time,header.stamp,topic,value", *lines]))
    text = MAP.format(time="", position="/joint_states/elbow/position", exertion="/wrench/torque/z")
    text = text.replace('time = { name = "", unit = "s" }', "")
    check_elbow(path, text)


def test_a_table_of_topics_without_times_is_a_table(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("\n".join(["topic,value,n", *(f"a,{k},1" for k in range(60))]))
    assert read_file(path, LogSection(motion="rotation")).array("value", "here").size == 60


def test_a_temperature_in_rows_of_its_own_is_a_stream(tmp_path: Path) -> None:
    """Joint states share their rows; what is slow has rows of its own, between these."""
    time_s, position, _ = moved("elbow")
    torque = -TRUE["elbow"].force(time_s)
    rows = [(t, f"{q:.9f},{tau:.9f},") for t, q, tau in zip(time_s, position, torque, strict=True)]
    rows += [(t + 0.0004, f",,{20.0 + t:.3f}") for t in time_s[::20]]
    path = tmp_path / "elbow.csv"
    path.write_text("\n".join(["__time,q,tau,/temp/data", *(f"{EPOCH_S + t:.6f},{row}" for t, row in sorted(rows))]))
    text = MAP.format(time="__time", position="q", exertion="tau")
    log = read_log(
        path, column_map(text.replace("[model]", 'temperature = { name = "/temp/data", unit = "degC" }\n[model]'))
    )
    inside = slice(10, -50)
    assert log.time_s.size == time_s.size
    assert log.columns["temperature"][inside] == pytest.approx(20.0 + log.time_s[inside], abs=0.01)


@pytest.mark.parametrize("every", [4, 7])
def test_a_position_in_every_so_many_rows_gives_the_rows(tmp_path: Path, every: int) -> None:
    time_s = np.arange(7000) / 1000
    known = np.arange(time_s.size) % every == 0
    columns = {"t": time_s, "q": np.where(known, np.sin(time_s), np.nan), "tau": np.cos(time_s)}
    path = write_csv(tmp_path / "log.csv", columns)
    log = read_log(path, column_map(MAP.format(time="t", position="q", exertion="tau")))
    np.testing.assert_allclose(log.time_s, time_s[known])
    np.testing.assert_allclose(log.columns["exertion"][1:-1], np.cos(time_s[known])[1:-1], atol=1e-4)


def test_rows_that_lack_their_position_by_chance_are_no_other_rate(tmp_path: Path) -> None:
    time_s = np.arange(3000) / 500
    known = np.random.default_rng(3).random(time_s.size) < 0.3
    columns = {"t": time_s, "q": np.where(known, np.sin(time_s), np.nan), "tau": np.cos(time_s)}
    path = write_csv(tmp_path / "log.csv", columns)
    with pytest.raises(UsageError, match="position holds no number in"):
        fit_logs(Request((path,), column_map(MAP.format(time="t", position="q", exertion="tau"))))
