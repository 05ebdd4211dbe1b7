"""The sections of a rig file under way, and the file's text: every line with a word on what it is."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field

COMMENT_AT = 36


@dataclass(frozen=True)
class Line:
    """``value`` is TOML already. What is not ``active`` is written as a comment, to show what there is."""

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
