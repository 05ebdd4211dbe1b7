"""The terminal UI: the sequence of screens, and the stop key, which works on all of them."""

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from multiprocessing import resource_tracker

from textual.app import App, SystemCommand
from textual.binding import Binding
from textual.driver import Driver
from textual.events import Event, Key
from textual.screen import Screen

from norton_bench.errors import BenchError
from norton_bench.screen.available import by_hand_choice, find_rigs, find_sessions, standard_choice
from norton_bench.screen.experiment import Experiment, Opening
from norton_bench.screen.keyboard import listening_to_keys
from norton_bench.screen.screens import keys
from norton_bench.screen.screens.by_hand import ByHandScreen
from norton_bench.screen.screens.choices import BY_HAND, ChoiceScreen, SessionChoice
from norton_bench.screen.screens.experiment import ExperimentScreen
from norton_bench.screen.screens.keys import KeyList
from norton_bench.screen.screens.questions import FIT_GIVEN_UP, Confirm
from norton_bench.screen.screens.results import ResultsScreen
from norton_bench.screen.settings import BENCH, OWN, STOP_KEY, Settings, user_themes
from norton_bench.screen.styles import PHONE

NO_RIGS = "There is no rig file in ./rigs or here.\n\nnorton-bench rig new my-rig.toml writes one from your answers."
# The time that Textual takes to close its palette, which would else be in the picture.
PALETTE_CLOSES_S = 0.1
SECTIONS: Mapping[str, Sequence[keys.AnyBinding]] = {
    "Everywhere": keys.APP,
    "At the experiment": keys.EXPERIMENT[1:],
    "At the results": keys.RESULTS,
}
BY_HAND_SECTIONS: Mapping[str, Sequence[keys.AnyBinding]] = {"Everywhere": keys.APP, "By hand": keys.BY_HAND[1:]}


class BenchApp(App[None]):
    """``opening`` makes experiments from rigs and sessions; ``first`` is the first one, None to choose one."""

    TITLE = "norton-bench"
    CSS_PATH = "screen.tcss"
    BINDINGS = keys.APP
    ENABLE_COMMAND_PALETTE = True
    HORIZONTAL_BREAKPOINTS = PHONE

    def __init__(self, opening: Opening, first: Experiment | None = None, settings: Settings | None = None) -> None:
        settings = settings or Settings()
        self._stop_keys = frozenset([STOP_KEY, *settings.keys.get(keys.STOP_ID, "").split(",")]) - {""}
        self.experiment: Experiment | None = None
        super().__init__()
        # Spawned sessions start a resource tracker that needs a real stderr, which the screen replaces.
        resource_tracker.ensure_running()
        self._opening, self._settings, self._first = opening, settings, first
        for theme in (*OWN, *user_themes(settings.themes)):
            self.register_theme(theme)
        self.theme = settings.theme or BENCH
        self.set_keymap(dict(settings.keys))

    def get_driver_class(self) -> type[Driver]:
        return listening_to_keys(super().get_driver_class(), self._key_pressed)

    def on_mount(self) -> None:
        self.run_worker(self._open(), exclusive=True, group="opening")

    async def _open(self) -> None:
        """Choose rig and session where they are not given, then show the experiment; repeat until the user leaves."""
        experiment = self._first
        while True:
            if experiment is None:
                experiment = await self._choose()
            if experiment is None:
                self.exit()
                return
            self.experiment, left = experiment, asyncio.Event()
            await self.push_screen(self._screen_for(experiment, left.set))
            await left.wait()
            await asyncio.to_thread(experiment.close)
            self.experiment = experiment = None
            while len(self.screen_stack) > 1:
                await self.pop_screen()

    def _screen_for(self, experiment: Experiment, abort: Callable[[], None]) -> Screen[None]:
        if experiment.by_hand is not None:
            return ByHandScreen(experiment, experiment.by_hand, fps=self._settings.fps, abort=abort)
        return ExperimentScreen(experiment, fps=self._settings.fps, abort=abort)

    async def _choose(self) -> Experiment | None:
        """Choose a rig, then a session on it; None where the user leaves."""
        while True:
            rig_path = self._opening.rig_path
            if rig_path is None:
                rigs = find_rigs(self._opening.folder)
                number = await self.push_screen_wait(ChoiceScreen("Which rig?", rigs.choices, NO_RIGS))
                if number is None:
                    return None
                rig_path = rigs.paths[number]
            rig = self._opening.load_rig(rig_path)
            sessions = await asyncio.to_thread(find_sessions, self._opening.folder, rig)
            choices = [standard_choice(rig), by_hand_choice(rig), *sessions.choices]
            number = await self.push_screen_wait(SessionChoice(f"Which session on {rig.name}?", choices, ""))
            if number == BY_HAND:
                return self._opening.by_hand(rig)
            if number is not None:
                try:
                    path = sessions.paths[number - 2] if number > 1 else None
                    return await asyncio.to_thread(self._opening.experiment, rig, path)
                except BenchError as error:
                    self.notify(str(error), title="Not on this rig", severity="error", timeout=15, markup=False)
            elif self._opening.rig_path is not None:
                return None

    def _key_pressed(self, key: str) -> None:
        """Called in the thread of the driver, before the key is handled."""
        if key in self._stop_keys and self.experiment is not None:
            self.experiment.stop()

    async def on_event(self, event: Event) -> None:
        """Handle the stop before bindings: a printable key of a binding would go to the field with the focus."""
        if isinstance(event, Key) and event.key in self._stop_keys and not event.is_forwarded and self._may_stop:
            self.action_stop()
            return
        await super().on_event(event)

    @property
    def _may_stop(self) -> bool:
        return self.experiment is not None and self.experiment.stoppable

    def action_stop(self) -> None:
        """Stop; called by the key and by the palette."""
        if self.experiment is not None:
            was_live = self.experiment.live
            self.experiment.stop()
            if was_live:
                self.notify("Stopping: the drives go idle at once; the recording is closed.", severity="warning")
            self.screen.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Without anything to stop, the space bar types a space."""
        if action == "stop":
            return self._may_stop
        return True

    def action_keys(self) -> None:
        by_hand = self.experiment is not None and self.experiment.by_hand is not None
        sections = [
            (
                title,
                [
                    (self._shown(binding), binding.tooltip)
                    for binding in bindings
                    if isinstance(binding, Binding) and not binding.system
                ],
            )
            for title, bindings in (BY_HAND_SECTIONS if by_hand else SECTIONS).items()
        ]
        self.push_screen(KeyList(sections))

    def _shown(self, binding: Binding) -> str:
        keyed = self._settings.keys.get(binding.id or "", binding.key)
        return " ".join(self.get_key_display(Binding(key.strip(), "")) for key in keyed.split(","))

    def action_leave(self) -> None:
        if self.experiment is not None and self.experiment.live:
            consequence = "The drives go idle at once." if self.experiment.moving else FIT_GIVEN_UP
            self.push_screen(Confirm("Leave the experiment?", consequence, "Stop and leave"), self._leave_if)
        else:
            self._leave_if(True)

    def _leave_if(self, sure: bool | None) -> None:
        if sure:
            if self.experiment is not None:
                self.experiment.stop("the operator left")
            self.run_worker(self._leave(), group="leaving")

    async def _leave(self) -> None:
        if self.experiment is not None:
            await asyncio.to_thread(self.experiment.close)
        self.exit()

    def show_results(self) -> None:
        """Show the result of the experiment; for a replay, start the fit of its recording."""
        if self.experiment is None:
            return
        if self.experiment.replay is not None:
            self.experiment.replay.fit()
        self.push_screen(ResultsScreen(self.experiment))

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Every action with a key by its name, each once; then those without a key."""
        told = set[str]()
        for active in screen.active_bindings.values():
            binding = active.binding
            if binding.tooltip and active.enabled and not binding.system and binding.action not in told:
                told.add(binding.action)
                node = active.node

                async def run(action: str = binding.action, target: object = node) -> None:
                    await self.run_action(action, target)  # type: ignore[arg-type]

                yield SystemCommand(binding.description, binding.tooltip, run)
        yield SystemCommand("Theme", "Change the colours", self.action_change_theme)
        yield SystemCommand("Screenshot", f"Save this screen as a picture in {self._opening.runs}", self._picture_soon)

    def _picture_soon(self) -> None:
        """Save the picture after the palette is closed."""
        self.set_timer(PALETTE_CLOSES_S, self._save_picture)

    def _save_picture(self) -> None:
        folder = self._opening.runs
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path = self.save_screenshot(path=str(folder))
        except OSError as error:
            message = f"cannot write into {folder}: {error.strerror}; choose another folder with --out"
            self.notify(message, title="No screenshot", severity="error", markup=False)
            return
        self.notify(path, title="Screenshot saved", markup=False)
