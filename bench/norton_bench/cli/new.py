"""``rig new``: asks what is on the bench, or takes the answers from the command line, and writes a rig file."""

import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from norton_bench.cli.arguments import Json
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from norton_bench.rig.new.options import Question

BACK = "<"

NewFile = Annotated[Path | None, Parameter(name="FILE", help="The rig file to write; NAME.toml if left out.")]
Set = Annotated[
    tuple[str, ...],
    Parameter(name="--set", help='An answer, e.g. --set actuator.node=1 or --set "limits.torque=1 N*m".'),
]
From = Annotated[Path | None, Parameter(name="--from", help="A rig file; its values become the defaults.")]
Yes = Annotated[bool, Parameter(help="Ask nothing: every other answer is its default.")]
Check = Annotated[
    Literal["simulated", "hardware", "none"] | None,
    Parameter(help="Which bench is checked at the end; default: the simulated twin, if the rig has one."),
]
Force = Annotated[bool, Parameter(help="Replace an existing file.")]


def new(
    file: NewFile = None,
    /,
    *,
    set_: Set = (),
    from_: From = None,
    yes: Yes = False,
    force: Force = False,
    check: Check = None,
    json: Json = False,
) -> int:
    """Write a new rig file from answers: asked one by one on a terminal, else taken from --set and the defaults.

    At the end the rig is checked, by default its simulated twin.
    """
    proposed = _proposed(from_)
    answers = _answers(set_)
    output = Output(json)
    asks = not yes and sys.stdin.isatty()
    if not asks:
        text = _prepared_text({**proposed, **answers}, answers, _stem(file), str(file or "new rig"))
    else:
        text = _asked_text({**proposed, **answers}, _stem(file), str(file or "new rig"))
    written = tomllib.loads(text)
    path = file or Path(f"{written['rig']['name']}.toml")
    _write(path, text, force=force, may_ask=asks)
    output.say(f"{path} is written")
    twin = "simulated" in written
    look = check or (_asked_check(twin=twin) if asks else "simulated" if twin else "none")
    if look == "none":
        output.result({"rig": path}, f"next: norton-bench rig check {path} --backend hardware")
        return ExitCode.OK
    return _checked(path, look, twin=twin, output=output)


def _asked_check(*, twin: bool) -> str:
    """Ask which bench to check; the hardware is not opened unless the user answers so."""
    from rich.console import Console  # noqa: PLC0415
    from rich.prompt import Prompt  # noqa: PLC0415

    choices = [*(("simulated",) if twin else ()), "hardware", "none"]
    text = (
        "check it now, on its simulated twin, or on the hardware (nothing moves)"
        if twin
        else ("check it now on the hardware (nothing moves)")
    )
    default = "simulated" if twin else "none"
    return str(Prompt.ask(text, choices=choices, default=default, console=Console(stderr=True)))


def _checked(path: Path, backend: str, *, twin: bool, output: Output) -> int:
    """Check the written file as ``rig check`` does; returns its exit code."""
    from norton_bench.check.check import check_rig  # noqa: PLC0415
    from norton_bench.cli.check import check_data, check_view, say_problems, standard_session_suits  # noqa: PLC0415
    from norton_bench.rig.load import load_rig  # noqa: PLC0415

    output.say(f"checking it, {backend}; the very first run compiles for a while")
    rig = load_rig(path, backend=backend)
    result = check_rig(rig)
    suits, refusal = standard_session_suits(rig, result)
    data = {"rig": path, "backend": backend, "check": {**check_data(result), "identify": refusal}}
    rehearse = (
        f"next: rehearse it with norton-bench identify {path} --backend simulated; on the bench itself, "
        if (twin)
        else "next: "
    )
    output.result(data, *check_view(result), suits, f"{rehearse}norton-bench rig check {path}")
    return say_problems(path, result, output)


def _stem(file: Path | None) -> str:
    return file.stem if file is not None else "my-bench"


def _prepared_text(known: Mapping[str, str], answers: Mapping[str, str], name: str, place: str) -> str:
    from norton_bench.rig.load import parse_rig  # noqa: PLC0415
    from norton_bench.rig.new.interview import Interview  # noqa: PLC0415
    from norton_bench.rig.new.options import Prepared  # noqa: PLC0415

    asker = Prepared(dict(known))
    text = Interview(asker, name).rig()
    asker.check_used(answers)
    parse_rig(text, place=place)
    return text


def _asked_text(known: Mapping[str, str], name: str, place: str) -> str:
    from rich.console import Console  # noqa: PLC0415

    from norton_bench.errors import RigError  # noqa: PLC0415
    from norton_bench.rig.load import parse_rig  # noqa: PLC0415
    from norton_bench.rig.new.interview import Interview  # noqa: PLC0415
    from norton_drivers.discovery import list_ports  # noqa: PLC0415

    asker = TerminalQuestions(Console(stderr=True, highlight=False), dict(known))
    asker.tell("looking for ports and adapters ...")
    ports = list_ports()
    asker.tell(f"Enter takes the value in brackets; {BACK} goes back to the question before")
    while True:
        try:
            text = Interview(asker, name, ports).rig()
            parse_rig(text, place=place)
        except StepBackError:
            asker.again()
        except RigError as error:
            asker.forget()
            asker.tell(f"these answers contradict each other:\n{error}\nplease answer again; Enter keeps an answer")
        else:
            return text


class StepBackError(Exception):
    """The user wants to go back to the question before."""


@dataclass
class TerminalQuestions:
    """Asks a person at a terminal, on standard error; earlier answers are proposed again.

    To go back, all questions are asked anew; those before the last take their earlier answers without being shown.
    """

    console: "Console"
    known: dict[str, str] = field(default_factory=dict)
    _given: list[str] = field(default_factory=list)  # in this round, in the order of the questions
    _place: int = 0  # how many of them were asked for

    def ask(self, question: "Question") -> str:
        if self._place < len(self._given):
            self._place += 1
            return question.accept(self._given[self._place - 1])
        if question.key in self.known:
            question = replace(question, default=self.known[question.key])
        while True:
            self.console.print(_asked(question), end=" ", markup=False, soft_wrap=True)
            typed = self.console.input().strip()
            if typed == BACK:
                self._step_back()
            answer = typed or question.default or ""
            try:
                accepted = question.accept(answer)
            except ValueError as error:
                self.tell(f"  {error}")
            else:
                self.known[question.key] = answer
                self._given.append(answer)
                self._place += 1
                return accepted

    def offers(self, key: str) -> bool:
        return key in self.known and key in self._proposed

    def tell(self, text: str) -> None:
        if self._place == len(self._given):
            self.console.print(text, markup=False, soft_wrap=True)

    def again(self) -> None:
        """Start at the first question; questions that were answered take their answers."""
        self._place = 0

    def forget(self) -> None:
        """Start at the first question, and ask every one."""
        self._given, self._place = [], 0

    def _step_back(self) -> None:
        if self._given:
            self._given.pop()
        raise StepBackError

    def __post_init__(self) -> None:
        # Of another file: what was typed here must not make more questions of the same answers when they are replayed.
        self._proposed = frozenset(self.known)


def _asked(question: "Question") -> str:
    choices = f" ({', '.join(question.choices)})" if question.choices and question.listed else ""
    hint = f" [{question.default}]" if question.default else f", e.g. {question.example}" if question.example else ""
    return f"{question.key}: {question.text}{choices}{hint}:"


def _answers(given: Sequence[str]) -> dict[str, str]:
    answers = {}
    for each in given:
        key, equals, value = each.partition("=")
        if not equals:
            raise UsageError(f"--set {each}: write it like --set actuator.node=1")
        answers[key.strip()] = value.strip()
    return answers


def _proposed(path: Path | None) -> dict[str, str]:
    """The values of another rig file, by the keys of the questions."""
    if path is None:
        return {}
    from norton_bench.rig.files import parse_toml, read_text  # noqa: PLC0415

    written = parse_toml(read_text(path, "rig file"), str(path))
    return dict(_flat({key: table for key, table in written.items() if key != "simulated"}))


def _flat(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every value by its dotted key, as it would be typed. A command becomes its limit, which has the command's unit,
    and its other keys."""
    from norton_bench.rig.files import toml  # noqa: PLC0415

    for key, value in tables.items():
        if key == "command" and isinstance(value, dict) and "limit" in value:
            yield prefix + key, str(value["limit"])
            yield from ((f"{prefix}{key}.{more}", str(value[more])) for more in ("lowest", "sent_as") if more in value)
        elif isinstance(value, dict) and prefix.count(".") < 2 and key != "options":
            yield from _flat(value, f"{prefix}{key}.")
        elif value != {}:
            yield prefix + key, value if isinstance(value, str) else toml(value)


def _write(path: Path, text: str, *, force: bool, may_ask: bool) -> None:
    if path.exists() and not force and not (may_ask and _overwrite(path)):
        raise UsageError(f"{path} exists already; name another file, or add --force")
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); name another file") from error


def _overwrite(path: Path) -> bool:
    from rich.console import Console  # noqa: PLC0415
    from rich.prompt import Confirm  # noqa: PLC0415

    return Confirm.ask(f"{path} exists already; replace it?", default=False, console=Console(stderr=True))
