"""The emulated VESC on a serial line, held against its firmware's source, and asked and commanded by PyVESC."""

from collections.abc import Callable
from typing import Any

import pytest

from norton_drivers.codecs import vesc, vesc_uart
from norton_drivers.codecs.vesc_uart import PacketStream, Say, Value, mask_of
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.drivers.peer_pyvesc import pyvesc
from tests.sim_backend.serial_host import SerialHost, host_of

BAUD = 921_600
OPTIONS = {"pole_pairs": 7, "minimum_current": 0.05, "watchdog": 1.0}
ASKED = mask_of(Value.Q_A, Value.ERPM, Value.FAULT, Value.POSITION_DEG, Value.STATUS)


@pytest.fixture
def open_host(
    wiring: Wiring, simulated: dict[str, Any], open_bench: Callable[..., SimulatedBackend]
) -> Callable[..., SerialHost]:
    def opened(baud: int = BAUD, **options: Any) -> SerialHost:
        truth = {**simulated["actuator"], "amplifier_gain": "1 A/A"}
        return host_of(open_bench, wiring, truth, "vesc_uart", "A", baud, **{**OPTIONS, **options})

    return opened


def current(amperes: float) -> bytes:
    return vesc_uart.packet(bytes((Say.SET_CURRENT,)) + vesc.current_value(amperes))


def values(host: SerialHost, mask: int = ASKED) -> dict[Value, float]:
    (answer,) = PacketStream().feed(host.ask(vesc_uart.packet(vesc_uart.ask_values(mask))))
    return vesc_uart.values_of(answer.payload)


def test_pyvesc_drives_it_and_reads_it(open_host: Callable[..., SerialHost]) -> None:
    host = open_host()
    interface, getters = pyvesc("protocol.interface"), pyvesc("VESC.messages.getters")
    setters = pyvesc("VESC.messages.setters")
    version, _ = interface.decode(host.ask(bytes(interface.encode_request(getters.GetVersion))))
    assert (version.comm_fw_version, version.fw_version_major) == (6, 5)  # its first field is not there any more
    for _ in range(20):
        host.send(bytes(interface.encode(setters.SetCurrent(2.0))))
        host.wait(5)
    assert host.current_a == pytest.approx(2.0, rel=1e-2)
    host.ask(bytes(interface.encode_request(getters.GetValues)))
    told, _ = interface.decode(host.ask(bytes(interface.encode_request(getters.GetValues))))
    assert told.avg_iq == pytest.approx(2.0, abs=0.05)
    assert told.v_in == 24.0
    assert told.rpm > 0
    assert told.pid_pos_now == pytest.approx(values(host)[Value.POSITION_DEG], abs=30)


def test_a_current_is_the_average_since_it_was_asked_for(open_host: Callable[..., SerialHost]) -> None:
    host = open_host()
    values(host)
    for amperes in (2.0, 1.0):
        for _ in range(10):
            host.send(current(amperes))
            host.wait(5)
    assert values(host)[Value.Q_A] == pytest.approx(1.5, abs=0.1)
    host.wait(5)
    assert values(host)[Value.Q_A] == pytest.approx(1.0, abs=0.05)


def test_an_answer_takes_the_lines_time(open_host: Callable[..., SerialHost]) -> None:
    question = vesc_uart.packet(vesc_uart.ask_values(ASKED))
    slow = open_host(115_200)
    assert slow.ask(question, 2.5) != b""
    slow.wait(5)
    assert len(slow.ask(question, 3.0)) < vesc_uart.answer_length(ASKED)  # 34 bytes need 3 ms, and travel
    assert len(open_host().ask(question, 2.0)) == vesc_uart.answer_length(ASKED)


def test_the_timeout_lets_go_and_shows(open_host: Callable[..., SerialHost]) -> None:
    host = open_host()
    host.send(current(1.0))
    host.wait(900)
    assert host.firmware.armed
    assert values(host)[Value.STATUS] == 0
    host.send(vesc_uart.packet(bytes((Say.ALIVE,))))
    host.wait(900)
    assert host.firmware.armed
    for _ in range(30):  # questions do not feed it
        values(host)
    assert not host.firmware.armed
    assert values(host)[Value.STATUS] == vesc_uart.TIMED_OUT
    host.send(current(1.0))
    host.wait(5)
    assert values(host)[Value.STATUS] == 0


def test_a_fault_stops_it_and_clears_itself(open_host: Callable[..., SerialHost]) -> None:
    host = open_host()
    host.send(current(1.0))
    host.wait(5)
    host.firmware.break_down(DriveFault.UNDERVOLTAGE)
    host.send(current(1.0))
    host.wait(5)
    assert not host.firmware.armed
    assert values(host)[Value.FAULT] == 2
    host.wait(520)
    assert values(host)[Value.FAULT] == 0


def test_only_the_controller_that_is_meant_answers(open_host: Callable[..., SerialHost]) -> None:
    host, question = open_host(forward=9), vesc_uart.ask_values(ASKED)
    assert host.ask(vesc_uart.packet(question)) == b""
    assert host.ask(vesc_uart.packet(vesc_uart.forwarded(question, 8))) == b""
    assert host.ask(vesc_uart.packet(vesc_uart.forwarded(question, 9))) != b""
