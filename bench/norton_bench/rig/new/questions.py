"""A question of ``rig new``, and whoever answers it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
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
