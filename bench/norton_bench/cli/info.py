"""``info``: what a recording contains, and the timing of its control loop."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from norton_bench.cli.arguments import Json, RecordingFile
from norton_bench.cli.output import Output, plain_table

if TYPE_CHECKING:
    from rich.table import Table

    from norton_bench.loop.timing import LoopTiming
    from norton_bench.recording.contents import Recording

# The metadata to show, in this order.
METADATA_SHOWN = ("rig", "rig_file", "session", "started", "backend", "loop", "devices")


def info(recording: RecordingFile, /, *, json: Json = False) -> None:
    """Show what a recording contains, and the timing of its control loop."""
    from norton_bench.loop.timing import loop_timing, timing_sentence  # noqa: PLC0415
    from norton_bench.recording.reader import read_recording  # noqa: PLC0415

    content = read_recording(recording, raw_frames=False)
    timing = loop_timing(content.measured.ticks)
    facts = {name: content.metadata[name] for name in METADATA_SHOWN if content.metadata.get(name)}
    events = [asdict(event) for event in content.measured.events]
    data = {**facts, "complete": content.complete, "timing": timing and _figures(timing), "events": events}
    shown: list[Any] = [_facts(content, facts)]
    if timing is not None:
        shown.append(timing_sentence(timing))
        if not timing.in_lock_step:
            shown.append(_timing(timing))
    Output(json).result(data, *shown)


def _figures(timing: "LoopTiming") -> dict[str, Any]:
    """The timing as ``--json`` prints it; all durations in nanoseconds."""
    return {**asdict(timing), "stages": {name: asdict(spread) for name, spread in timing.stages}}


def _facts(recording: "Recording", facts: dict[str, str]) -> "Table":
    from rich.table import Table  # noqa: PLC0415

    from norton_bench.records import FOR_PROGRAMS  # noqa: PLC0415

    table = Table.grid(padding=(0, 2))
    for name, words in facts.items():
        table.add_row(name.replace("_", " "), words)
    ticks = recording.measured.ticks["tick_ns"]
    if len(ticks):
        table.add_row("bench time", f"{(ticks[-1] - ticks[0]) * 1e-9:.1f} s")
    table.add_row("state", "complete" if recording.complete else "cut off; norton-bench recover repairs it")
    for event in recording.measured.events:
        if event.kind not in FOR_PROGRAMS:
            table.add_row(event.kind, event.text)
    return table


def _timing(timing: "LoopTiming") -> "Table":

    from norton_bench.loop.timing import timing_rows  # noqa: PLC0415

    head, rows = timing_rows(timing)
    table = plain_table()
    for place, heading in enumerate(head):
        table.add_column(heading, justify="right" if place else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table
