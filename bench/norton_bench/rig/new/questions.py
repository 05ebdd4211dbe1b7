"""A question of ``rig new``, and whoever answers it."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Protocol

from norton_bench.errors import UsageError


def anything(text: str) -> str:
    """Any answer will do."""
    return text


@dataclass(frozen=True)
class Question:
    """``key`` is where the answer goes in the rig file, e.g. "actuator.node"; ``check`` makes it what is written there.

    ``check`` raises ValueError, in a sentence, for what cannot be. No ``default``: it must be answered.
    """

    key: str
    text: str
    default: str | None = None
    example: str = ""
    choices: tuple[str, ...] = ()
    check: Callable[[str], str] = anything

    def accept(self, text: str) -> str:
        """The answer as it will be written. Raises ValueError, in a sentence."""
        text = text.strip()
        if self.choices and text not in self.choices:
            raise ValueError(f'"{text}" is none of {", ".join(self.choices)}')
        return self.check(text)


class Asker(Protocol):
    """Answers questions: a person at a terminal, or what was said on the command line."""

    def ask(self, question: Question) -> str:
        """An answer that the question accepts. Raises UsageError where there is none."""
        ...

    def offers(self, key: str) -> bool:
        """Whether there is an answer to what would otherwise not be asked."""
        ...

    def tell(self, text: str) -> None:
        """Something that helps to answer what comes next."""
        ...


@dataclass
class Prepared:
    """Answers given beforehand, by key; the rest takes its default."""

    answers: dict[str, str]

    def __post_init__(self) -> None:
        self.asked: list[str] = []

    def ask(self, question: Question) -> str:
        self.asked.append(question.key)
        answer = self.answers.get(question.key, question.default)
        if answer is None:
            like = question.example or "..."
            raise UsageError(f"{question.key} is not answered: add --set {question.key}={like} ({question.text})")
        try:
            return question.accept(answer)
        except ValueError as error:
            raise UsageError(f"--set {question.key}={answer}: {error}") from None

    def offers(self, key: str) -> bool:
        return key in self.answers

    def tell(self, text: str) -> None:
        """Nobody is there to read."""

    def check_used(self, keys: Iterable[str]) -> None:
        """Raises UsageError for an answer to what nobody asked."""
        for key in keys:
            if key not in self.asked:
                raise UsageError(f"--set {key}: nobody asked for that here; asked were {', '.join(self.asked)}")


COMMENT_AT = 36


@dataclass(frozen=True)
class Line:
    """The sections of a rig file under way, and the file's text: every line with a word on what it is.

    ``value`` is TOML already. What is not ``active`` is written as a comment, to show what there is.
    """

    key: str
    value: str
    comment: str = ""
    active: bool = True

    def text(self) -> str:
        return _commented(f"{'' if self.active else '# '}{self.key} = {self.value}", self.comment)


@dataclass
class Section:
    """``name`` as in [name]."""

    name: str
    comment: str = ""
    lines: list[Line] = field(default_factory=list)

    def add(self, key: str, value: str, comment: str = "", *, active: bool = True) -> None:
        self.lines.append(Line(key, value, comment, active))

    def text(self) -> str:
        return "\n".join([_commented(f"[{self.name}]", self.comment), *(line.text() for line in self.lines)])


def rig_text(sections: Iterable[Section]) -> str:
    """The whole file."""
    first = "# Written by `norton-bench rig new`; docs/rig-file.md explains every key, docs/devices.md every device."
    return "\n\n".join([first, *(section.text() for section in sections)]) + "\n"


def _commented(text: str, comment: str) -> str:
    return f"{text:<{COMMENT_AT - 1}} # {comment}" if comment else text


def quoted(text: str) -> str:
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False)
