"""What a section of the report is made of."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Facts:
    """A small table: its head and its rows, all text."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Section:
    """A heading, sentences, pictures and tables; ``figures`` are (SVG, caption)."""

    name: str  # the anchor
    title: str
    sentences: tuple[str, ...] = ()
    figures: tuple[tuple[str, str], ...] = ()
    tables: tuple[Facts, ...] = field(default=())
