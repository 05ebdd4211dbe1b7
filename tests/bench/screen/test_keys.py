"""Every key on every screen, pressed."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from textual.binding import Binding
from textual.pilot import Pilot
from textual.widgets import Input, OptionList

from norton_bench.errors import ExitCode, ExperimentError
from norton_bench.events import Ended, Note, Prompt, Question, SessionState, StateChanged
from norton_bench.screen.app import BenchApp
from norton_bench.screen.experiment import Experiment, Opening
from norton_bench.screen.screens import keys
from norton_bench.screen.screens.choices import ChoiceScreen
from norton_bench.screen.screens.experiment import WINDOWS_S, ExperimentScreen
from norton_bench.screen.screens.keys import KeyList
from norton_bench.screen.screens.questions import Ask, Confirm, Mark
from norton_bench.screen.screens.results import ResultsScreen
from norton_bench.screen.settings import Settings
from norton_bench.session.operator import Order
from tests.bench.screen.svg_grid import seen

ROOT = Path(__file__).parents[3]
RESULT = Ended(ExitCode.OK, report=Path("runs/report.html"))


@asynccontextmanager
async def running(
    first: Experiment | None, settings: Settings | None = None, opening: Opening | None = None
) -> AsyncIterator[tuple[BenchApp, Pilot[None]]]:
    app = BenchApp(opening or Opening(lambda _: Path()), first, settings)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        yield app, pilot


def at_experiment(app: BenchApp) -> ExperimentScreen:
    assert isinstance(app.screen, ExperimentScreen)
    return app.screen


async def frame(app: BenchApp, pilot: Pilot[None]) -> None:
    """One frame at once, and everything that follows from it."""
    next(screen for screen in app.screen_stack if isinstance(screen, ExperimentScreen))._frame()
    await pilot.pause()


async def started(live: Experiment, app: BenchApp, pilot: Pilot[None]) -> None:
    await pilot.press("s")
    await frame(app, pilot)
    assert live.live


async def until(pilot: Pilot[None], came: Callable[[], bool]) -> None:
    """Wait for what happens in its own time."""
    for _ in range(200):
        if came():
            return
        await pilot.pause(0.05)
    raise AssertionError("it did not come")


def shown(app: BenchApp) -> set[str]:
    """The ids of what the keys do on this screen now."""
    return {active.binding.id or "" for active in app.screen.active_bindings.values()}


async def test_start_waits_for_its_key(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await frame(app, pilot)
        assert live.source is None
        assert "start" in shown(app)
        assert not {"pause", "tare", "mark", "skip", "stop", "seek_on"} & shown(app)
        await started(live, app, pilot)
        assert {"pause", "tare", "mark", "skip", "stop"} <= shown(app)
        assert "start" not in shown(app)


@pytest.mark.long
async def test_orders_and_that_pause_and_resume_share_a_key(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        for key, order in (("t", "tare"), ("n", "skip"), ("p", "pause")):
            session.orders.clear()
            await pilot.press(key)
            assert session.orders == [Order(order)]  # type: ignore[arg-type]
        session.next_events.append(StateChanged(SessionState.PAUSED))
        await frame(app, pilot)
        assert "resume" in shown(app)
        assert "pause" not in shown(app)
        await pilot.press("p")
        assert [order.kind for order in session.orders] == ["pause", "resume"]


@pytest.mark.long
async def test_a_mark_is_typed(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        await pilot.press("m", *"loud", "enter")
        await pilot.pause()
        assert session.orders == [Order("mark", "loud")]
        await pilot.press("m", "escape")
        await pilot.pause()
        assert len(session.orders) == 1


@pytest.mark.long
async def test_a_prompt_opens_by_itself_and_is_answered(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        for prompt, press, answer in (
            (Prompt("load", "Which load is mounted?", ("none", "disc")), ["tab", "enter"], "disc"),
            (Prompt("who", "Who is there?"), ["h", "i", "enter"], "hi"),
        ):
            session.next_events += [StateChanged(SessionState.ASKING), Question(prompt)]
            await frame(app, pilot)
            assert isinstance(app.screen, Ask)
            await pilot.press("escape")
            assert "answer" in shown(app)
            await pilot.press("enter")
            assert isinstance(app.screen, Ask)
            await pilot.press(*press)
            await pilot.pause()
            assert session.orders[-1] == Order("answer", answer)
            session.next_events.append(StateChanged(SessionState.RUNNING))
            await frame(app, pilot)
            assert "answer" not in shown(app)


async def test_abort_asks_first(live: Experiment, session) -> None:
    opening = Opening(lambda _: Path(), folder=ROOT)
    async with running(live, opening=opening) as (app, pilot):
        await started(live, app, pilot)
        await pilot.press("a")
        assert isinstance(app.screen, Confirm)
        await pilot.press("n")
        assert not session.stops
        await pilot.press("a", "y")
        await pilot.pause()
        assert session.stops == ["the operator aborted it"]
        await until(pilot, lambda: isinstance(app.screen, ChoiceScreen))
        assert session.closed


@pytest.mark.long
async def test_leaving_a_running_experiment_asks_and_stops_it(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        for key in ("q", "ctrl+q", "ctrl+c"):
            await pilot.press(key)
            assert isinstance(app.screen, Confirm)
            await pilot.press("escape")
        assert not session.stops
        await pilot.press("q", "y")
        await until(pilot, lambda: session.closed)
        assert session.stops == ["the operator left"]


async def test_results_follow_the_end(live: Experiment, session, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setenv("DISPLAY", ":0")
    async with running(live) as (app, pilot):
        monkeypatch.setattr(app, "open_url", opened.append)
        await started(live, app, pilot)
        assert "results" not in shown(app)
        session.replay.seek(session.replay.duration_s)
        session.next_events += [StateChanged(SessionState.DONE), RESULT]
        await frame(app, pilot)
        assert "start" in shown(app)  # once more
        await pilot.press("r")
        assert isinstance(app.screen, ResultsScreen)
        await pilot.pause(0.3)
        await pilot.press("o")
        assert opened == [Path("runs/report.html").resolve().as_uri()]
        for key in ("escape", "r", "r"):
            await pilot.press(key)
        at_experiment(app)
        # Over ssh no browser is opened: a text browser would take the terminal.
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
            monkeypatch.delenv(name, raising=False)
        await pilot.press("r", "o")
        assert len(opened) == 1


@pytest.mark.long
async def test_views(replayed: Experiment) -> None:
    visible = {
        "1": {"torque", "velocity", "command", "parameters", "steps"},
        "2": {"torque-velocity", "torque-position"},
        "3": {"source", "parameters"},
        "4": {"health", "log"},
    }
    async with running(replayed) as (app, pilot):
        for key in "4123":
            await pilot.press(key)
            await pilot.pause()
            seen_now = [each for each in app.screen.query("Plot, Panel") if each.region.area and each.is_on_screen]
            assert {widget.id for widget in seen_now} - {"title", "views"} == visible[key]


@pytest.mark.long
async def test_after_the_end_a_resize_draws_everything_again(replayed: Experiment) -> None:
    """No event follows then, so nothing but the resize draws."""
    assert replayed.replay is not None
    replayed.replay.replay.pause()
    async with running(replayed) as (app, pilot):
        replayed.seek(12.0)
        await frame(app, pilot)
        wanted = await as_drawn(app, pilot)
        for size in ((20, 4), (80, 24), (200, 60), (80, 24)):
            await pilot.resize_terminal(*size)
            await pilot.pause()
            assert seen(app.export_screenshot()).rows == await as_drawn(app, pilot)
        assert await as_drawn(app, pilot) == wanted


async def as_drawn(app: BenchApp, pilot: Pilot[None]) -> tuple[str, ...]:
    """The rows of the screen once everything was drawn anew."""
    at_experiment(app).draw_frame(all_of_it=True)
    await pilot.pause()
    return seen(app.export_screenshot()).rows


async def test_the_window_of_time(replayed: Experiment) -> None:
    async with running(replayed) as (app, pilot):
        screen = at_experiment(app)
        usual = screen._window
        for key, step in (("plus", 1), ("minus", 0), ("minus", -1), ("equals_sign", 0)):
            await pilot.press(key)
            assert screen._window == usual + step
        await pilot.press(*["plus"] * 9)
        assert screen._window == len(WINDOWS_S) - 1


async def test_the_log_scrolls(replayed: Experiment) -> None:
    async with running(replayed) as (app, pilot):
        replayed.seek(12.0)
        await frame(app, pilot)
        await pilot.press("pageup")
        assert at_experiment(app)._back > 0
        await pilot.press("pagedown")
        assert at_experiment(app)._back == 0


@pytest.mark.long
async def test_a_replay_is_moved(replayed: Experiment) -> None:
    async with running(replayed) as (app, pilot):
        assert replayed.replay is not None
        replay = replayed.replay.replay
        for key, where in (
            ("right", 5.0),
            ("right", 10.0),
            ("left", 5.0),
            ("shift+left", 0.0),
            ("end", replay.duration_s),
        ):
            await pilot.press(key)
            assert replay.now_s == pytest.approx(where)
        await frame(app, pilot)
        assert replayed.picture.known.valid == 7
        await pilot.press("home")
        await frame(app, pilot)
        assert replayed.picture.known.valid == 0
        await pilot.press("shift+right")
        assert replay.now_s == min(30.0, replay.duration_s)
        await pilot.press("up")
        assert replay.speed == 2.0
        await pilot.press("down", "down")
        assert replay.speed == 0.5
        assert not {"start", "tare", "mark", "skip"} & shown(app)


async def test_a_replay_pauses_resumes_and_stops(replayed: Experiment) -> None:
    async with running(replayed) as (_app, pilot):
        assert replayed.replay is not None
        replay = replayed.replay.replay
        await pilot.press("p")
        assert replay.paused
        await pilot.press("p")
        assert not replay.paused
        await pilot.press("space")
        assert replay.paused


WAYS_TO_BE_BUSY: dict[str, Callable[[Pilot[None]], object]] = {
    "experiment": lambda pilot: pilot.pause(),
    "loops": lambda pilot: pilot.press("2"),
    "source": lambda pilot: pilot.press("3"),
    "bench": lambda pilot: pilot.press("4"),
    "mark": lambda pilot: pilot.press("m", "x"),
    "abort": lambda pilot: pilot.press("a"),
    "leave": lambda pilot: pilot.press("q"),
    "keys": lambda pilot: pilot.press("question_mark"),
    "palette": lambda pilot: pilot.press("ctrl+p", "t"),
}


async def test_space_stops_wherever_one_is(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        for way, go in WAYS_TO_BE_BUSY.items():
            session.stops.clear()
            await go(pilot)  # type: ignore[misc]
            await pilot.pause()
            assert (way in ("experiment", "loops", "source", "bench")) == isinstance(app.screen, ExperimentScreen), way
            await pilot.press("space")
            assert session.stops == ["the operator, by key"], way
            assert all(" " not in field.value for field in app.screen.query(Input)), way
            while not isinstance(app.screen, ExperimentScreen):
                await app.pop_screen()
        # While asked, and at the results.
        session.stops.clear()
        session.next_events += [StateChanged(SessionState.ASKING), Question(Prompt("who", "Who is there?"))]
        await frame(app, pilot)
        await pilot.press("x", "space")
        assert len(session.stops) == 1
        await app.push_screen(ResultsScreen(live))
        await pilot.press("space")
        assert len(session.stops) == 2


async def test_space_is_a_space_where_nothing_can_be_stopped(live: Experiment) -> None:
    async with running(live) as (app, pilot):
        await app.push_screen(Mark())
        await pilot.press("a", "space", "b")
        assert app.screen.query_one(Input).value == "a b"


async def test_the_driver_hears_the_stop_before_the_event_loop(live: Experiment, session) -> None:
    """What the key thread calls says the stop itself: nothing of the event loop is waited for."""
    async with running(live, Settings(keys={"stop": "space,f12"})) as (app, pilot):
        await started(live, app, pilot)
        app._key_pressed("x")
        assert not session.stops
        app._key_pressed("space")
        app._key_pressed("f12")
        assert len(session.stops) == 2


async def test_help_lists_every_key_with_what_it_does(live: Experiment) -> None:
    async with running(live, Settings(keys={"pause": "f5"})) as (app, pilot):
        await pilot.press("question_mark")
        assert isinstance(app.screen, KeyList)
        listed = [described for _, section in app.screen._sections for described in section]
        bindings = [each for each in (*keys.APP, *keys.EXPERIMENT, *keys.RESULTS) if isinstance(each, Binding)]
        assert {said for _, said in listed} == {binding.tooltip for binding in bindings if not binding.system}
        assert next(key for key, said in listed if said.startswith("Pause")) == "f5"
        await pilot.press("f1")
        at_experiment(app)


@pytest.mark.long
async def test_the_palette_has_the_keys_actions(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        names = {command.title for command in app.get_system_commands(app.screen)}
        assert {"Start", "Overview", "Loops", "Keys", "Theme"} <= names
        await pilot.press("ctrl+p", *"start")
        await pilot.pause(0.5)
        await pilot.press("enter")
        await until(pilot, lambda: live.source is session)


@pytest.mark.long
async def test_the_palette_names_everything_once(live: Experiment, replayed: Experiment) -> None:
    """However many keys a command has, and whatever textual would add of its own."""
    for experiment in (live, replayed):
        async with running(experiment) as (app, _pilot):
            names = [command.title for command in app.get_system_commands(app.screen)]
            assert len(names) == len(set(names))
            assert {"Keys", "Quit", "Screenshot"} <= set(names)


@pytest.mark.long
async def test_a_screenshot_goes_where_runs_go_and_makes_the_folder(live: Experiment, tmp_path: Path) -> None:
    """No Downloads folder is asked for."""
    runs = tmp_path / "not yet" / "runs"
    async with running(live, opening=Opening(lambda _: tmp_path, runs=runs)) as (_app, pilot):
        await pilot.press("ctrl+p", *"screenshot")
        await pilot.pause(0.5)
        await pilot.press("enter")
        await until(pilot, lambda: runs.is_dir() and len(list(runs.glob("*.svg"))) == 1)
        (picture,) = runs.glob("*.svg")
        await until(pilot, lambda: picture.read_text(encoding="utf-8").endswith("</svg>\n"))
        assert "Parameters" in picture.read_text(encoding="utf-8")


async def test_a_screenshot_that_cannot_be_written_says_why(live: Experiment, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    async with running(live, opening=Opening(lambda _: tmp_path, runs=tmp_path / "file")) as (app, pilot):
        app._save_picture()
        await until(pilot, lambda: len(app._notifications) == 1)
        (told,) = app._notifications
        assert "choose another folder with --out" in told.message


async def test_while_it_is_fitted_there_is_progress_and_no_key_that_does_nothing(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        session.next_events.append(StateChanged(SessionState.CONCLUDING))
        session.next_events.append(Note("final fit 2/4: friction models"))
        await frame(app, pilot)
        assert not {"stop", "pause", "tare", "mark", "skip"} & shown(app)
        bar = "".join(text for row in at_experiment(app)._views(80, 1) for text, _ in row)
        assert "final fit 2/4: friction models  0 s" in bar
        await pilot.press("space")
        assert not session.stops
        await pilot.press("r")
        await pilot.pause()
        assert isinstance(app.screen, ResultsScreen)
        page = "".join(text for row in app.screen._rows(76, 20) for text, _ in row)
        assert "final fit 2/4: friction models" in page
        session.next_events.append(StateChanged(SessionState.DONE))
        session.next_events.append(RESULT)
        await frame(app, pilot)
        await until(pilot, lambda: "open_report" in shown(app))


@pytest.mark.long
async def test_leaving_while_it_is_fitted_says_what_is_given_up(live: Experiment, session) -> None:
    async with running(live) as (app, pilot):
        await started(live, app, pilot)
        session.next_events.append(StateChanged(SessionState.CONCLUDING))
        await frame(app, pilot)
        await pilot.press("q")
        assert isinstance(app.screen, Confirm)
        assert "recording is complete" in app.screen._consequence
        await pilot.press("y")
        await until(pilot, lambda: session.closed)


@pytest.mark.long
async def test_keys_are_renamed_by_the_settings(live: Experiment, session) -> None:
    async with running(live, Settings(theme="nord", keys={"start": "f2", "tare": "f3"})) as (app, pilot):
        assert app.theme == "nord"
        await pilot.press("s")
        assert live.source is None
        await pilot.press("f2")
        await frame(app, pilot)
        await pilot.press("f3")
        assert session.orders == [Order("tare")]


@pytest.mark.long
async def test_rig_and_session_are_chosen(tmp_path: Path) -> None:
    opening = Opening(lambda _: tmp_path, folder=ROOT)
    async with running(None, opening=opening) as (app, pilot):
        assert isinstance(app.screen, ChoiceScreen)
        await pilot.press("down", "down")
        await pilot.press("enter")
        await pilot.pause()
        assert isinstance(app.screen, ChoiceScreen)
        await pilot.press("escape")
        await pilot.pause()
        await pilot.press("enter")
        await pilot.pause()
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, ExperimentScreen))
        assert at_experiment(app).experiment.what == "the standard session"
        assert app.experiment is not None
        assert app.experiment.source is None


@pytest.mark.long
async def test_a_session_that_the_rig_cannot_perform_is_marked_and_says_why(tmp_path: Path) -> None:
    rig = ROOT / "rigs" / "sim-free-shaft.toml"
    async with running(None, opening=Opening(lambda _: tmp_path, rig, folder=ROOT)) as (app, pilot):
        await until(pilot, lambda: isinstance(app.screen, ChoiceScreen))
        names = [str(option.prompt).strip() for option in app.screen.query_one(OptionList).options]
        assert names[0] == "standard session"
        assert "✗ quick" in names
        for _ in range(names.index("✗ quick")):
            await pilot.press("down")
        await pilot.press("enter")
        await pilot.pause()
        said = str(app.screen.query_one("#said").render())  # type: ignore[attr-defined]
        assert "step 'calibrate' needs a load drive" in said
        assert isinstance(app.screen, ChoiceScreen)
        assert app.experiment is None


def test_a_simulated_bus_that_no_real_one_could_be_is_refused(tmp_path: Path) -> None:
    rig = tmp_path / "slow.toml"
    text = (ROOT / "rigs" / "sim-odrive.toml").read_text(encoding="utf-8")
    rig.write_text(text.replace('bitrate = "1 Mbit/s"', 'bitrate = "200 kbit/s"'), encoding="utf-8")
    opening = Opening(lambda _: tmp_path, rig, folder=ROOT)
    with pytest.raises(ExperimentError, match="of what 200000 bit/s can carry"):
        opening.experiment(opening.load_rig(rig), None)


async def test_no_rig_is_said_with_the_way_to_one(tmp_path: Path) -> None:
    opening = Opening(lambda _: tmp_path, folder=tmp_path)
    async with running(None, opening=opening) as (app, pilot):
        assert "norton-bench rig new" in str(app.screen.query_one("#said").render())  # type: ignore[attr-defined]
        await pilot.press("escape")
        await pilot.pause()
    assert not app.is_running


def test_every_key_has_an_id_and_says_what_it_does() -> None:
    groups = [keys.APP, keys.EXPERIMENT[1:], keys.RESULTS, keys.PICK, Mark.BINDINGS, Ask.BINDINGS, Confirm.BINDINGS]
    bindings = [each for group in (*groups, KeyList.BINDINGS) for each in group if isinstance(each, Binding)]
    assert all(binding.id and binding.tooltip for binding in bindings)
    assert len({binding.id for binding in bindings}) == len(bindings)
    assert [binding.key for binding in bindings if binding.priority] == ["space"]
