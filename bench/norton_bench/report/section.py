"""The parts of a section of the report."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Facts:
    """A small table: its head and its rows, as text."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure as SVG. ``purpose`` is its use for the reader, ``caption`` describes what is drawn."""

    markup: str
    purpose: str
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, sentences, pictures and tables; ``points`` are sentences that stand in a list below the others."""

    name: str  # the anchor
    title: str
    sentences: tuple[str, ...] = ()
    figures: tuple[Picture, ...] = ()
    tables: tuple[Facts, ...] = ()
    points: tuple[str, ...] = ()
