"""Every screen at four sizes, from a real simulated experiment. NORTON_BENCH_SNAPSHOTS=write writes them anew."""

import os
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot

from norton_bench.events import Prompt
from norton_bench.records import Measured
from norton_bench.screen.app import BenchApp
from norton_bench.screen.experiment import Experiment, Opening
from norton_bench.screen.screens.experiment import ExperimentScreen
from norton_bench.screen.screens.questions import Ask, Mark
from norton_bench.screen.screens.results import ResultsScreen
from tests.bench.screen.conftest import ROOT, Performed, in_fixed_places
from tests.bench.screen.svg_grid import differences, seen

STORED = Path(__file__).parent / "snapshots"
WRITE = os.environ.get("NORTON_BENCH_SNAPSHOTS") == "write"
SIZES = [(45, 30), (80, 24), (160, 45), (200, 60)]
SIZE_IDS = [f"{columns}x{rows}" for columns, rows in SIZES]
SETTLED_S, LOOKS = 5.0, 50
BASE = 2  # screens, of which the experiment's is the upper one
Show = Callable[[BenchApp, Pilot[None], Experiment], Coroutine[None, None, None]]


def moment(measured: Measured, procedure: str, name: str) -> float:
    """When the last segment of that name is almost over."""
    segment = [s for s in measured.segments if s.procedure == procedure and s.name.startswith(name)][-1]
    return (segment.end_ns - int(measured.ticks["tick_ns"][0])) * 1e-9 - 0.05


def at(procedure: str, name: str, *keys: str) -> Show:
    async def show(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
        assert experiment.replay is not None
        experiment.seek(moment(experiment.replay.replay.measured, procedure, name))
        await pilot.press(*keys)
        await drawn(app, pilot)

    return show


async def drawn(app: BenchApp, pilot: Pilot[None]) -> None:
    """With everything in it that is known by now."""
    screen = next(screen for screen in app.screen_stack if isinstance(screen, ExperimentScreen))
    screen._frame()
    await pilot.pause()
    screen.draw_frame(all_of_it=True)
    await pilot.pause()


async def ready(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
    fresh = Experiment(experiment.rig, "sessions/short.toml", lambda: pytest.fail("nobody started it"))
    app.experiment = fresh
    await app.push_screen(ExperimentScreen(fresh, fps=25, abort=lambda: None))
    await pilot.pause()


async def asked(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
    await at("free", "staircase falling")(app, pilot, experiment)
    await app.push_screen(Ask(Prompt("load", "Mount the disc, then say which one.", ("small", "large"))))
    await pilot.pause()


async def marking(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
    await at("free", "staircase falling")(app, pilot, experiment)
    await app.push_screen(Mark())
    await pilot.pause()


async def choosing(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
    app.run_worker(app._choose())
    await pilot.pause()
    await pilot.press("down")
    await pilot.pause()


def results_of(performed: Performed) -> Show:
    async def show(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
        assert experiment.replay is not None
        done = Experiment(experiment.rig, "sessions/short.toml", lambda: pytest.fail("nobody started it"))
        experiment.replay.replay.seek(1e9)
        for event in experiment.replay.events():
            done.picture.take(event)
        done.picture.take(in_fixed_places(performed.summary))
        await app.push_screen(ResultsScreen(done))
        await pilot.pause()

    return show


# In this order: the view stays as it is until another is chosen.
SCREENS: dict[str, Show] = {
    "overview": at("imposed", "loop 15 mrad", "1"),
    "keys": at("imposed", "loop 15 mrad", "question_mark"),
    "palette": at("imposed", "loop 15 mrad", "ctrl+p"),
    "ask": asked,
    "mark": marking,
    "loops": at("imposed", "loop 50 mrad", "2"),
    "source": at("free", "staircase falling", "3"),
    "bench": at("validate", "rest", "4"),
    "ready": ready,
    "choice": choosing,
}


async def compare(name: str, app: BenchApp, pilot: Pilot[None]) -> None:
    """It has a few seconds to look so: widgets are mounted when the machine comes to it."""
    path = STORED / f"{name}-{app.size.width}x{app.size.height}.svg"
    if WRITE:
        await pilot.pause(SETTLED_S)
        path.write_text(app.export_screenshot(), encoding="utf-8")
    assert path.exists(), f"{path} is not there; NORTON_BENCH_SNAPSHOTS=write writes it"
    wanted, found = seen(path.read_text(encoding="utf-8")), list[str]()
    for _ in range(LOOKS):
        found = differences(wanted, seen(app.export_screenshot()))
        if not found:
            break
        await pilot.pause(SETTLED_S / LOOKS)
    assert found == [], name


@pytest.mark.long
@pytest.mark.parametrize("size", SIZES, ids=SIZE_IDS)
async def test_every_screen_looks_as_it_did(performed: Performed, replayed: Experiment, size: tuple[int, int]) -> None:
    """One after the other in one app: what a start costs, each would cost."""
    assert replayed.replay is not None
    replayed.replay.replay.pause()
    app = BenchApp(Opening(lambda _: Path(), folder=ROOT), replayed)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        for name, show in {**SCREENS, "results": results_of(performed)}.items():
            await show(app, pilot, replayed)
            await compare(name, app, pilot)
            await back_to_experiment(app, pilot, replayed)


async def back_to_experiment(app: BenchApp, pilot: Pilot[None], experiment: Experiment) -> None:
    """Whatever was opened over it is closed."""
    while len(app.screen_stack) > BASE:
        await app.pop_screen()
    app.experiment = experiment
    await pilot.pause()


@pytest.mark.long
async def test_without_colour_it_says_the_same(replayed: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """NO_COLOR: greys alone, and every word and curve of the coloured screen."""
    assert replayed.replay is not None
    replayed.replay.replay.pause()
    svgs = []
    for colour in (True, False):
        monkeypatch.setenv("NO_COLOR", "1") if not colour else monkeypatch.delenv("NO_COLOR", raising=False)
        app = BenchApp(Opening(lambda _: Path()), replayed)
        async with app.run_test(size=(120, 36)) as pilot:
            await pilot.pause()
            await SCREENS["overview"](app, pilot, replayed)
            svgs.append(app.export_screenshot())
    coloured, grey = map(seen, svgs)
    assert coloured.rows == grey.rows
    assert all(is_grey(rule) for rule in grey.colours)
    assert not all(is_grey(rule) for rule in coloured.colours)


def is_grey(rule: str) -> bool:
    red, green, blue = (int(rule.partition("#")[2][place : place + 2], 16) for place in (0, 2, 4))
    return max(red, green, blue) - min(red, green, blue) <= 4


def test_the_comparison_sees_what_a_reader_sees() -> None:
    svg = (STORED / "overview-80x24.svg").read_text(encoding="utf-8")
    before = seen(svg)
    assert any("Parameters" in row for row in before.rows)
    assert differences(before, seen(svg.replace("Torque", "Twist"))) != []
    assert differences(before, replace(before, rows=before.rows[:-1])) != []
    emptied = tuple("".join(" " if 0x2800 <= ord(c) < 0x2900 else c for c in row) for row in before.rows)
    assert differences(before, replace(before, rows=emptied)) != []
    other_digits = tuple(row.replace("1", "7").replace("2", "3") for row in before.rows)
    assert differences(before, replace(before, rows=other_digits)) == []
