"""What a serial line carries, and a line that is behind."""

import pytest

from norton_bench.testing import ScriptedWorld
from norton_drivers.serial_drive import NewestFirst
from norton_drivers.serial_timing import USB, USB_BAUD, Exchange, opened_at
from norton_drivers.wiring import DeviceSettings

# 10 bytes are 0.868 ms at 115200 baud.
SLOW = Exchange(115_200, 10, 10, 30, 0.2e-3)


def test_what_a_line_carries() -> None:
    assert SLOW.round_s == pytest.approx(40 * 10 / 115_200 + 0.2e-3)
    assert SLOW.greatest_rate_hz == pytest.approx(1 / SLOW.round_s)
    assert [SLOW.ticks(tick_s) for tick_s in (5e-3, 2e-3, 1e-3)] == [1, 2, 4]
    assert SLOW.share_there(2e-3) == pytest.approx((10 + 10 / 2) * 10 / 115_200 / 2e-3)
    assert SLOW.share_back(5e-3) == pytest.approx(30 * 10 / 115_200 / 5e-3)
    assert [SLOW.serves(tick_s) for tick_s in (5e-3, 2e-3, 1e-3)] == [True, True, False]


def test_commands_alone_can_fill_a_line() -> None:
    lopsided = Exchange(115_200, 40, 10, 10, 0.0)
    assert lopsided.greatest_rate_hz == pytest.approx(0.9 * 115_200 / 10 / 50)
    assert not lopsided.serves(4e-3)


def test_a_usb_port_of_its_own_is_opened_at_some_rate() -> None:
    assert (opened_at(USB), opened_at(9600)) == (USB_BAUD, 9600)


def test_of_commands_that_pile_up_the_newest_is_sent() -> None:
    world = ScriptedWorld()
    link = world.link()
    settings = DeviceSettings("actuator", "x", port="line")
    line = NewestFirst(link.serial_port(settings, 9600), link, 9600)
    for number in range(50):
        line.send_newest(b"%04d" % number)  # 4.2 ms each
        link.wait()
    sent = b"".join(world.line.sent)
    assert 4 * 9 <= len(sent) <= 4 * 14
    assert sent.startswith(b"0000")
    link.wait(10_000_000)
    assert b"".join(world.line.sent).endswith(b"0049")
    link.wait(10_000_000)
    line.send_newest(b"0050")
    line.send_newest(b"0051")
    line.drop()
    line.send(b"stop")
    link.wait(20_000_000)
    assert b"".join(world.line.sent).endswith(b"0050stop")
