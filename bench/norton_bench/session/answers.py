"""Answers to prompts that are given beforehand, so that a session can run without anybody there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from norton_bench.errors import UsageError
from norton_bench.rig.files import nearest
from norton_bench.session.progress import Prompt

YES = "yes"


@dataclass(frozen=True)
class Answers:
    """``given`` by the prompt's name; with ``yes``, every other prompt is answered with "yes", or its first choice."""

    given: Mapping[str, str] = field(default_factory=dict)
    yes: bool = False

    def to(self, prompt: Prompt) -> str | None:
        """None where somebody has to be asked."""
        if prompt.name in self.given:
            return self.given[prompt.name]
        if not self.yes:
            return None
        return prompt.choices[0] if prompt.choices else YES

    def check(self, prompts: Sequence[Prompt], place: str, *, somebody: bool) -> None:
        """Raises UsageError for answers that fit no prompt, and where nobody is there for the prompts that are left."""
        names = {prompt.name: prompt for prompt in prompts}
        for name, answer in self.given.items():
            if name not in names:
                raise UsageError(f"--answer {name}={answer}: {place} asks nothing of that name; {nearest(name, names)}")
            choices = names[name].choices
            if choices and answer not in choices:
                raise UsageError(f"--answer {name}={answer}: is none of {', '.join(choices)}")
        for prompt in prompts:
            if not somebody and self.to(prompt) is None:
                raise unanswered(prompt, place)


def unanswered(prompt: Prompt, place: str) -> UsageError:
    """The error of a prompt that nobody can answer."""
    return UsageError(
        f'{place}: asks "{prompt.text}", and nobody is there to answer; run it on a terminal, or answer with '
        f"--answer {prompt.name}=... or --yes"
    )


NO_ANSWERS = Answers()


def parsed(written: Sequence[str]) -> dict[str, str]:
    """``["fixture=A"]`` by name. Raises UsageError for one without a name, or given twice."""
    given: dict[str, str] = {}
    for assignment in written:
        name, equals, answer = assignment.partition("=")
        if not equals or not name:
            raise UsageError(f"--answer {assignment}: write it like --answer fixture=A")
        if name in given:
            raise UsageError(f"--answer {name}: is given twice; give it once")
        given[name] = answer
    return given
