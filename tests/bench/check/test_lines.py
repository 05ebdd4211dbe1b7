"""Drives on serial lines: what a line carries is told, and who else is at its other end."""

import re
from pathlib import Path

import pytest

from norton_bench.check.check import check_rig
from norton_bench.errors import RigError
from norton_bench.rig.load import load_rig, parse_rig
from tests.bench.check.test_families import really, sentences

RIGS = Path(__file__).parents[3] / "rigs"
VESC, ODRIVE, SIMPLEFOC = (RIGS / f"sim-{name}.toml" for name in ("vesc-uart", "odrive-uart", "simplefoc"))


def test_what_a_line_carries_is_told() -> None:
    (line,) = check_rig(load_rig(VESC), seed=1).lines
    assert line.baud == 921_600
    assert 0 < line.share_there < line.share_back < 0.5
    assert line.greatest_rate_hz > 1000
    assert line.answer_s is not None
    assert 0.8e-3 < line.answer_s < 2e-3
    assert line.remarks == ()


def test_a_line_that_cannot_serve_the_rate_is_refused() -> None:
    text = VESC.read_text().replace("baud = 921600", "baud = 115200").replace('rate = "500 Hz"', 'rate = "1 kHz"')
    with pytest.raises(
        RigError, match=r"\[rig\] rate.*1000 Hz is more than the line of \[actuator\] carries"
    ) as caught:
        parse_rig(text, place="rig.toml")
    assert re.search(r'write rate = "\d+ Hz"', str(caught.value))


@pytest.mark.parametrize(
    ("path", "change", "words"),
    [
        (
            VESC,
            ('driver = "vesc_uart"', 'driver = "vesc"'),
            'is for a device on CAN; write driver = "vesc_uart", or bus',
        ),
        (RIGS / "sim-vesc.toml", ('driver = "vesc"', 'driver = "vesc_uart"'), 'write driver = "vesc", or port'),
    ],
)
def test_the_other_kind_of_line(path: Path, change: tuple[str, str], words: str) -> None:
    with pytest.raises(RigError) as caught:
        parse_rig(path.read_text().replace(*change), place="rig.toml")
    assert words in str(caught.value)


def test_a_line_that_serves_every_other_tick_is_remarked() -> None:
    text = VESC.read_text().replace("baud = 921600", "baud = 115200")
    result = check_rig(parse_rig(text, place="rig.toml", backend="simulated"), seed=1)
    assert any("carries a reading in one tick of" in remark for remark in result.remarks)
    assert result.problems() == ()


def test_answers_that_come_later_than_the_next_tick_are_remarked() -> None:
    text = VESC.read_text().replace('rate = "500 Hz"', 'rate = "1 kHz"')
    result = check_rig(parse_rig(text, place="rig.toml", backend="simulated"), seed=1)
    assert any("later than the next tick" in remark for remark in result.remarks)


@pytest.mark.parametrize(
    ("path", "device", "words"),
    [
        (VESC, {"baud": 115_200}, "at 115200 baud there is a VESC, firmware 6.05; set baud = 115200"),
        (ODRIVE, {"baud": 115_200}, "at 115200 baud there is an ODrive; set baud = 115200"),
        (
            SIMPLEFOC,
            {"baud": 115_200},
            "at 115200 baud there is a SimpleFOC board with the commands M; set baud = 115200",
        ),
        (
            ODRIVE,
            {"driver": "vesc_uart", "pole_pairs": 7, "baud": 921_600},
            'at 921600 baud there is a VESC, firmware 6.05; set driver = "vesc_uart"',
        ),
        (
            VESC,
            {"driver": "simplefoc", "current_limit": "9 A", "baud": 115_200},
            'at 115200 baud there is a SimpleFOC board with the commands M; set driver = "simplefoc", baud = 115200',
        ),
        (
            VESC,
            {"driver": "dynamixel", "node": 3, "type": "XM430-W210", "baud": 57_600},
            "at 57600 baud there is a Dynamixel (XM430-W210); "
            'set driver = "dynamixel", baud = 57600, node = 3, type = "XM430-W210"',
        ),
        (ODRIVE, {"firmware": "0.5"}, 'says it runs firmware 0.5.6; the rig file has firmware = "0.6"'),
        (VESC, {"plugged": False}, "nobody known answers at the other usual baud rates either"),
    ],
)
def test_who_does_not_answer(path: Path, device: dict[str, object], words: str) -> None:
    rig = load_rig(path)
    (found,) = sentences(really(rig, "actuator", **device))
    assert found.startswith("[actuator]")
    assert words in found
