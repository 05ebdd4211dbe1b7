"""What is measured of an actuator without a model, reading by reading."""

from bench.report.words import number, pretty_unit
from bench.screen.figures import FALLING, RISING
from bench.screen.picture.tabulated import Reading, Tabulated
from bench.screen.tones import LABEL, STRONG, TEXT, Row, heading

KIND, COLUMN = 10, 12


def table_rows(tabulated: Tabulated, command_unit: str, width: int, height: int) -> list[Row]:
    """One row a reading, the newest last."""
    readings = list(tabulated.readings.values())
    count = f"{len(readings)} readings" if readings else ""
    rows = [heading("Tables", "", count, width)]
    if not readings:
        return [
            *rows,
            [("no model is fitted: source and exertion", LABEL)],
            [("are tabulated, and fill in here", LABEL)],
        ]
    headings = (("command", "position", "torque"), (f"[{pretty_unit(command_unit)}]", "[rad]", "[N·m]"))
    rows += [_labels(words) for words in headings]
    room = max(height - len(rows), 1)
    return [*rows, *(_row(reading) for reading in readings[-room:])]


def _labels(words: tuple[str, ...]) -> Row:
    return [(" " * KIND, LABEL), *((f"{word:>{COLUMN}}", LABEL) for word in words)]


def _row(reading: Reading) -> Row:
    values = (reading.command, reading.position_rad, reading.torque_nm)
    sign = RISING if reading.rising else FALLING
    return [(f"{sign} {reading.what:<{KIND - 2}}", STRONG), *((f"{_short(value):>{COLUMN}}", TEXT) for value in values)]


def _short(value: float) -> str:
    """Ten thousandths are as much as can be read in passing."""
    return number(round(value, 4), 3)
