"""The event log."""

from norton_bench.screen.picture.log import Log
from norton_bench.screen.tones import BAD, LABEL, TEXT, UNIT, WARNING, Row, fitted, heading

KIND, TIME = 9, 8
TONES = {"stop": BAD, "fault": WARNING, "bus": WARNING, "device": WARNING, "drive": WARNING, "operator": TEXT}


def log_rows(log: Log, width: int, height: int, *, back: int = 0) -> list[Row]:
    """The last lines, or those ``back`` lines before them; a line that is too long is cut."""
    lines = list(log.lines)[: len(log.lines) - back] if back else list(log.lines)
    said = f"{back} newer below" if back else ""
    rows = [heading("Events", "", said, width)]
    for line in lines[-max(height - 1, 0) :]:
        time = "" if line.time_s is None else f"{line.time_s:.1f} s".replace("-", "−")
        kind = "" if line.kind == "note" else line.kind
        rows.append(
            fitted(
                [(time.rjust(TIME), LABEL), (f" {kind:<{KIND}}", UNIT), (line.text, TONES.get(line.kind, LABEL))], width
            )
        )
    return rows
