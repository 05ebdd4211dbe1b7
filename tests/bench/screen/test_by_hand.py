"""The bench moved by hand, at the screen: what every key orders, what is shown, and how it looks."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from textual.pilot import Pilot

from norton_bench.errors import ExitCode
from norton_bench.events import Ended, Note, SessionEvent, SessionState, StateChanged
from norton_bench.jog.by_hand import Jog
from norton_bench.jog.hands import LoadDoes, Preset, Setpoints, bounds_of
from norton_bench.jog.script import JogScript
from norton_bench.jog.signals import SignalValue
from norton_bench.rig.load import load_rig
from norton_bench.screen.app import BenchApp
from norton_bench.screen.experiment import Experiment, Opening
from norton_bench.screen.panels.health import signal_rows
from norton_bench.screen.picture.picture import LogLine
from norton_bench.screen.screens.by_hand import ByHandScreen
from norton_bench.screen.screens.choices import ChoiceScreen
from norton_bench.screen.screens.keys import KeyList
from norton_bench.screen.screens.questions import Body, Confirm
from norton_bench.session.engine import run_by_hand
from norton_bench.session.operator import Order
from norton_bench.session.replay import Replay, load_replay
from tests.bench.screen.conftest import RIGS, ROOT, Clock, Stand
from tests.bench.screen.svg_grid import seen as grid
from tests.bench.screen.test_keys import shown, until
from tests.bench.screen.test_snapshots import SIZE_IDS, SIZES, compare

RIG = load_rig(RIGS / "sim-odrive.toml")
HELD_S = 1.4
PHONE = 45


@pytest.fixture(scope="module")
def jogged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A recording of a bench moved by hand, and what was said meanwhile."""
    events: list[SessionEvent] = []
    setpoints = Setpoints(0.03, LoadDoes.TORQUE, 0.02)
    script = JogScript(bounds_of(RIG), Preset(setpoints, HELD_S))
    recording = run_by_hand(RIG, script, out=tmp_path_factory.mktemp("jog"), seed=1, on_event=events.append)
    return recording, [event.text for event in events if isinstance(event, Note)]


@pytest.fixture
def session(jogged: tuple[Path, list[str]], clock: Clock) -> Stand:
    stand = Stand(Replay(load_replay(jogged[0])[1], clock=clock))
    stand.next_events += [Note(text) for text in jogged[1] if text.startswith("device ")]
    return stand


@pytest.fixture
def by_hand(session: Stand) -> Experiment:
    return Experiment(RIG, "jog", lambda: session, by_hand=Jog())


@asynccontextmanager
async def at_hand(
    experiment: Experiment, size: tuple[int, int] = (80, 24), opening: Opening | None = None
) -> AsyncIterator[tuple[BenchApp, Pilot[None]]]:
    app = BenchApp(opening or Opening(lambda _: Path()), experiment)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        yield app, pilot


async def frame(app: BenchApp, pilot: Pilot[None]) -> ByHandScreen:
    screen = next(screen for screen in app.screen_stack if isinstance(screen, ByHandScreen))
    screen._frame()
    await pilot.pause()
    screen.draw_frame(all_of_it=True)
    await pilot.pause()
    return screen


async def moving(app: BenchApp, pilot: Pilot[None], clock: Clock, at_s: float = HELD_S - 0.1) -> ByHandScreen:
    """Started, and replayed up to a moment."""
    await pilot.press("s")
    await frame(app, pilot)
    clock.now_s += at_s
    return await frame(app, pilot)


@pytest.mark.long
async def test_nothing_is_ordered_before_it_was_started(by_hand: Experiment, session: Stand) -> None:
    async with at_hand(by_hand) as (app, pilot):
        await frame(app, pilot)
        await pilot.press("up", "right", "0", "v", "k", "escape", "enter")
        assert session.orders == []
        assert by_hand.source is None
        assert "by_hand_start" in shown(app)
        assert not {"back_to_zero", "load_up", "by_hand_end", "stop"} & shown(app)


@pytest.mark.long
async def test_every_key_orders_what_it_says(by_hand: Experiment, session: Stand, clock: Clock) -> None:
    """The session obeys none of them: each begins where the one before it did, but for the size of the steps."""
    async with at_hand(by_hand) as (app, pilot):
        await moving(app, pilot, clock, 0.5)
        for keys, order in (
            (["up"], "actuator 0.02"),
            (["down"], "actuator -0.02"),
            (["right"], "load 0.02"),
            (["left"], "load -0.02"),
            (["c"], "coast"),
            (["t"], "torque"),
            (["v"], "velocity"),
            (["z"], "zero_torque"),
            (["0"], "zero"),
            (["enter"], "here"),
            (["escape"], "end"),
            (["k", "y"], "calibrate"),
            (["b", "backspace", *"5e-4", "tab", "backspace", *"0.02", "enter"], "body 0.0005 0.02 0.0"),
            (["b", "tab", "tab", *"2", "tab", "minus", *"0.1", "enter"], "body 0.0005 0.02 2.0 -0.1"),
            (["plus", "up"], "actuator 0.05"),
            (["minus", "minus", "minus", "minus", "down"], "actuator -0.005"),
        ):
            await pilot.press(*keys)
            await pilot.pause()
            # What is typed into a window tells that somebody is there.
            assert [each for each in session.orders if each.text != "here" or order == "here"] == [
                Order("jog", order)
            ], keys
            session.orders.clear()


@pytest.mark.long
async def test_space_stops_it_while_a_question_is_open(by_hand: Experiment, session: Stand, clock: Clock) -> None:
    async with at_hand(by_hand) as (app, pilot):
        await moving(app, pilot, clock, 0.5)
        await pilot.press("k")
        assert isinstance(app.screen, Confirm)
        await pilot.press("space")
        assert session.stops
        assert session.orders == []


@pytest.mark.long
async def test_after_a_stop_it_is_started_again(by_hand: Experiment, session: Stand, clock: Clock) -> None:
    async with at_hand(by_hand) as (app, pilot):
        await moving(app, pilot, clock, 0.5)
        session.next_events += [
            StateChanged(SessionState.FAILED),
            Ended(ExitCode.INTERRUPTED, "stopped by the operator: space"),
        ]
        await frame(app, pilot)
        assert not by_hand.live
        assert "by_hand_start" in shown(app)
        await pilot.press("s")
        assert by_hand.live


async def test_a_bench_without_a_load_has_no_keys_for_it(session: Stand, clock: Clock) -> None:
    alone = Experiment(load_rig(RIGS / "sim-free-shaft.toml"), "jog", lambda: session, by_hand=Jog())
    async with at_hand(alone) as (app, pilot):
        await pilot.press("s")
        await pilot.pause()
        assert "nudge_up" in shown(app)
        assert not {"load_up", "load_turns", "calibrate"} & shown(app)


async def test_least_and_greatest_begin_anew(by_hand: Experiment, clock: Clock) -> None:
    async with at_hand(by_hand) as (app, pilot):
        await moving(app, pilot, clock)
        velocity = next(seen for seen in by_hand.picture.signals.seen() if seen.name == "velocity")
        assert velocity.least < velocity.value - 1.0
        await pilot.press("r")
        velocity = next(seen for seen in by_hand.picture.signals.seen() if seen.name == "velocity")
        assert velocity.least == velocity.value == velocity.greatest


async def test_an_answer_that_the_log_cuts_is_shown_whole(by_hand: Experiment, clock: Clock) -> None:
    async with at_hand(by_hand) as (app, pilot):
        await moving(app, pilot, clock, 0.5)
        answer = "this bench cannot render 0.0005 kg*m^2 of mass: the load would swing; it can with a damping of 0.005"
        for text in ("mark: the load stays at +1 N*m", f"mark: {answer}"):
            by_hand.picture.log.add(LogLine(0.5, "operator", text))
        await frame(app, pilot)
        await frame(app, pilot)
        assert [each.message for each in app._notifications] == [answer]


@pytest.mark.parametrize("typed", [["minus", "1"], ["minus"]])
async def test_a_body_is_not_negative(by_hand: Experiment, session: Stand, clock: Clock, typed: list[str]) -> None:
    async with at_hand(by_hand) as (app, pilot):
        await moving(app, pilot, clock, 0.5)
        await pilot.press("b", *typed, "enter")
        assert isinstance(app.screen, Body)
        await pilot.press("escape")
        assert isinstance(app.screen, ByHandScreen)
        assert {each.text for each in session.orders} == {"here"}


@pytest.mark.long
async def test_it_is_chosen_beside_the_sessions(tmp_path: Path) -> None:
    opening = Opening(lambda _: tmp_path, RIGS / "sim-odrive.toml", folder=ROOT)
    async with at_hand(None, opening=opening) as (app, pilot):  # type: ignore[arg-type]
        await until(pilot, lambda: isinstance(app.screen, ChoiceScreen))
        said = [command.title for command in app.get_system_commands(app.screen)]
        assert "By hand" in said
        await pilot.press("j")
        await until(pilot, lambda: isinstance(app.screen, ByHandScreen))
        assert app.experiment is not None
        assert app.experiment.by_hand == Jog()
        await pilot.press("question_mark")
        assert isinstance(app.screen, KeyList)
        assert [title for title, _ in app.screen._sections] == ["Everywhere", "By hand"]
        await pilot.press("escape", "a")
        await until(pilot, lambda: isinstance(app.screen, ChoiceScreen))
        await pilot.press("down", "enter")
        await until(pilot, lambda: isinstance(app.screen, ByHandScreen))


def test_a_row_has_value_unit_age_and_extremes() -> None:
    seen = (
        SignalValue("actuator", "velocity", "rad/s", -12.3456, 0.25, -20.0, 1e9),
        SignalValue("actuator", "supply", "V", 24.0),
        SignalValue("port", "torque", "N*m", -1e-9, 1e-3, 0.0, 0.5),
    )
    rows = signal_rows(seen, 0.2, 78, 20, live=True)
    text = ["".join(run for run, _ in row).split() for row in rows]
    assert ["actuator", "velocity", "−12.346", "rad/s", "250.0", "ms", "−20.000", "1.000e+09"] in text
    assert ["supply", "24.00", "V", "–", "–"] in text
    assert ["port", "torque", "0.0000", "N·m", "1.0", "ms", "0.0000", "0.5000"] in text
    assert all(sum(len(run) for run, _ in row) <= 78 for row in rows)
    old = next(row for row in rows if any("velocity" in run for run, _ in row))
    assert any(style == "warning" and "250.0 ms" in run for run, style in old)


def test_on_a_phone_a_row_has_them_too() -> None:
    seen = (
        SignalValue("actuator", "velocity", "rad/s", -12.3456, 0.25, -20.0, 1e9),
        SignalValue("actuator", "supply", "V", 24.0),
        SignalValue("load", "torque command", "N*m", -0.12345, 1.5, -1.5, 0.5),
    )
    rows = signal_rows(seen, 0.2, PHONE, 20, live=True)
    text = ["".join(run for run, _ in row) for row in rows]
    assert [row.split() for row in text] == [
        ["Signals", "now", "ms", "least", "most"],
        ["actuator"],
        ["velocity", "rad/s", "−12.346", "250", "−20.00", "1e+09"],
        ["supply", "V", "24.00", "–", "–"],
        ["load"],
        ["torque", "command", "N·m", "−0.1235", "999", "−1.500", "0.5000"],
    ]
    assert all(len(row) == PHONE for row in text)


async def test_on_a_phone_it_says_when_all_returns_to_zero(by_hand: Experiment, clock: Clock) -> None:
    async with at_hand(by_hand, (PHONE, 30)) as (app, pilot):
        await moving(app, pilot, clock)
        rows = [row.strip() for row in grid(app.export_screenshot()).rows]
        assert "actuator +0.03 N·m, load +0.02 N·m" in rows
        assert "step 2 %: 0.01 N·m, 0.02 N·m" in rows
        assert any(row.startswith("no key: all to zero in") and row.endswith(" s") for row in rows)
        assert "torques off at 40 rad/s" in rows


@pytest.mark.long
@pytest.mark.parametrize("size", SIZES, ids=SIZE_IDS)
async def test_it_looks_as_it_did(by_hand: Experiment, clock: Clock, size: tuple[int, int]) -> None:
    """``compare`` fails where the picture is not the one that was kept."""
    async with at_hand(by_hand, size) as (app, pilot):
        await frame(app, pilot)
        await compare("by-hand-ready", app, pilot)
        screen = await moving(app, pilot, clock)
        screen._jog = Jog(dead_man_s=1e3)  # a countdown of as many digits however long this takes
        await frame(app, pilot)
        await compare("by-hand", app, pilot)
        await pilot.press("d")
        await frame(app, pilot)
        await compare("by-hand-devices", app, pilot)
