"""What is measured of an actuator without a model, reading by reading."""

from norton_bench.report.words import number, pretty_unit
from norton_bench.screen.figures import FALLING, RISING
from norton_bench.screen.picture.tabulated import Reading, Tabulated
from norton_bench.screen.tones import LABEL, STRONG, TEXT, Row, heading

KIND, COLUMN, LEAST_COLUMN = 10, 12, 8
WORDS = ("command", "position", "torque")
SMALL = 1e-3  # below, a power of ten would be written


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
    columns = _columns(width)
    rows += [_labels(words, columns) for words in (WORDS, (f"[{pretty_unit(command_unit)}]", "[rad]", "[N·m]"))]
    room = max(height - len(rows), 1)
    return [*rows, *(_row(reading, columns) for reading in readings[-room:])]


def _columns(width: int) -> list[int]:
    """How wide each is: as much as there is room for, within bounds."""
    least = [max(len(word) + 1, LEAST_COLUMN) for word in WORDS]
    spare = max(width - KIND - sum(least), 0) // len(WORDS)
    return [min(column + spare, COLUMN) for column in least]


def _labels(words: tuple[str, ...], columns: list[int]) -> Row:
    return [(" " * KIND, LABEL), *((f"{word:>{column}}", LABEL) for word, column in zip(words, columns, strict=True))]


def _row(reading: Reading, columns: list[int]) -> Row:
    sign = RISING if reading.rising else FALLING
    values = zip((reading.command, reading.position_rad, reading.torque_nm), columns, strict=True)
    return [
        (f"{sign} {reading.what:<{KIND - 2}}", STRONG),
        *((f"{_short(value):>{column}}", TEXT) for value, column in values),
    ]


def _short(value: float) -> str:
    """Ten thousandths are as much as can be read in passing."""
    rounded = round(value, 4)
    return f"{rounded:.4f}".replace("-", "−") if 0.0 < abs(rounded) < SMALL else number(rounded, 3)
