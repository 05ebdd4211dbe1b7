"""``rig new``: asks what is on the bench, or takes the answers from the command line, and writes a rig file."""

import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Json
from norton_bench.cli.output import Output
from norton_bench.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from norton_bench.rig.new.questions import Question

NewFile = Annotated[Path | None, Parameter(name="FILE", help="The rig file to write; NAME.toml if left out.")]
Set = Annotated[
    tuple[str, ...],
    Parameter(name="--set", help='An answer, e.g. --set actuator.node=1 or --set "limits.torque=1 N*m".'),
]
From = Annotated[Path | None, Parameter(name="--from", help="A rig file whose values are proposed.")]
Yes = Annotated[bool, Parameter(help="Ask nothing: what is not answered takes its default.")]
Force = Annotated[bool, Parameter(help="Write over a file that is there already.")]


def new(
    file: NewFile = None,
    /,
    *,
    set_: Set = (),
    from_: From = None,
    yes: Yes = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a new rig file from answers: asked one by one on a terminal, else taken from --set and the defaults."""
    proposed = _proposed(from_)
    answers = _answers(set_)
    output = Output(json)
    if yes or not sys.stdin.isatty():
        text = _prepared_text({**proposed, **answers}, answers, _stem(file), str(file or "new rig"))
    else:
        text = _asked_text({**proposed, **answers}, _stem(file), str(file or "new rig"))
    path = file or Path(f"{tomllib.loads(text)['rig']['name']}.toml")
    _write(path, text, force=force, may_ask=not yes and sys.stdin.isatty())
    output.result({"rig": path}, f"{path} is written; next: norton-bench rig check {path}")


def _stem(file: Path | None) -> str:
    return file.stem if file is not None else "my-bench"


def _prepared_text(known: Mapping[str, str], answers: Mapping[str, str], name: str, place: str) -> str:
    from norton_bench.rig.load import parse_rig  # noqa: PLC0415
    from norton_bench.rig.new.interview import Interview  # noqa: PLC0415
    from norton_bench.rig.new.questions import Prepared  # noqa: PLC0415

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

    asker = Terminal(Console(stderr=True, highlight=False), dict(known))
    asker.tell("looking for what is plugged in ...")
    ports = list_ports()
    while True:
        text = Interview(asker, name, ports).rig()
        try:
            parse_rig(text, place=place)
        except RigError as error:
            asker.tell(f"these answers contradict each other:\n{error}\nonce more; Enter keeps an answer")
        else:
            return text


@dataclass
class Terminal:
    """A person at a terminal, asked on standard error; what was answered before is proposed again."""

    console: "Console"
    known: dict[str, str] = field(default_factory=dict)

    def ask(self, question: "Question") -> str:
        if question.key in self.known:
            question = replace(question, default=self.known[question.key])
        while True:
            self.console.print(_asked(question), end=" ", markup=False, soft_wrap=True)
            typed = self.console.input().strip() or question.default or ""
            try:
                accepted = question.accept(typed)
            except ValueError as error:
                self.tell(f"  {error}")
            else:
                self.known[question.key] = typed
                return accepted

    def offers(self, key: str) -> bool:
        return key in self.known

    def tell(self, text: str) -> None:
        self.console.print(text, markup=False, soft_wrap=True)


def _asked(question: "Question") -> str:
    choices = f" ({', '.join(question.choices)})" if 0 < len(question.choices) < 12 else ""
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
    """Every value by its dotted key, as it would be typed; a command by its limit, whose unit is the command's, and by
    what else it says."""
    from norton_bench.rig.mistakes import toml  # noqa: PLC0415

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
        raise UsageError(f"{path} is there already; name another file, or add --force")
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); name another file") from error


def _overwrite(path: Path) -> bool:
    from rich.console import Console  # noqa: PLC0415
    from rich.prompt import Confirm  # noqa: PLC0415

    return Confirm.ask(f"{path} is there already; write over it?", default=False, console=Console(stderr=True))
