"""The emulated ODrive and SimpleFOC board on serial lines, held against their firmware's source, in plain text."""

from collections.abc import Callable
from typing import Any

import pytest

from norton_drivers.codecs.odrive_ascii import line
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.sim_backend.serial_host import SerialHost, host_of

BAUD = 921_600
Opened = Callable[..., SerialHost]


@pytest.fixture
def odrive(wiring: Wiring, simulated: dict[str, Any], open_bench: Callable[..., SimulatedBackend]) -> Opened:
    def opened(firmware: str = "0.6", baud: int = BAUD) -> SerialHost:
        return host_of(
            open_bench, wiring, simulated["actuator"], "odrive_uart", "N*m", baud, firmware=firmware, watchdog=0.1
        )

    return opened


@pytest.fixture
def simplefoc(wiring: Wiring, simulated: dict[str, Any], open_bench: Callable[..., SimulatedBackend]) -> Opened:
    def opened(unit: str = "A", gain: str = "1 A/A", **options: Any) -> SerialHost:
        truth = {**simulated["actuator"], "amplifier_gain": gain}
        return host_of(open_bench, wiring, truth, "simplefoc", unit, BAUD, **options)

    return opened


def read(host: SerialHost, path: str) -> str:
    return host.ask(f"r {path}\n".encode()).decode().strip()


def close_loop(host: SerialHost) -> None:
    for text in ("w axis0.controller.config.control_mode 1", "w axis0.controller.config.input_mode 1", "c 0 0"):
        host.send(f"{text}\n".encode())
        host.wait(2)
    host.send(b"w axis0.requested_state 8\n")
    host.wait(2)


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
def test_an_odrive_closes_its_loop_and_drives(odrive: Opened, firmware: str) -> None:
    host = odrive(firmware)
    assert (read(host, "fw_version_major"), read(host, "fw_version_minor")) == ("0", firmware[-1])
    assert read(host, "vbus_voltage") == "24.000000"
    close_loop(host)
    assert read(host, "axis0.current_state") == "8"
    host.send(b"c 0 0.1\n")
    host.wait(20)
    assert host.current_a == pytest.approx(1.8, rel=0.05)
    position_rev, velocity_rev_s = map(float, host.ask(b"f 0 ; comment\n").split())
    assert position_rev > 0
    assert velocity_rev_s > 0
    host.send(b"w axis0.requested_state 1\n")
    host.wait(2)
    assert not host.firmware.armed


def test_an_odrive_answers_as_it_is_asked(odrive: Opened) -> None:
    host = odrive()
    assert host.ask(line("f 0")) == line("0.000000 0.000000", b"\r\n")
    assert host.ask(b"f 0*1\n") == b""
    assert host.ask(b"f 1\n") == b"invalid motor 1\r\n"
    assert host.ask(b"r no.such\n") == b"invalid property\r\n"
    assert host.ask(b"x\n") == b"unknown command\r\n"
    assert host.ask(b"c 0\n") == b"invalid command format\r\n"
    assert host.ask(b"f 0\nf 0\n").count(b"\r\n") == 1, "what comes while it is answering is dropped"


@pytest.mark.parametrize(("firmware", "name", "bits"), [("0.5", "error", 1 << 11), ("0.6", "active_errors", 1 << 24)])
def test_an_odrives_watchdog_is_fed_by_commands_alone(odrive: Opened, firmware: str, name: str, bits: int) -> None:
    host = odrive(firmware)
    host.send(b"w axis0.config.watchdog_timeout 0.1\nu 0\nw axis0.config.enable_watchdog 1\n")
    host.wait(3)
    close_loop(host)
    for _ in range(20):
        host.send(b"c 0 0.05\n")
        host.wait(20)
    assert host.firmware.armed
    for _ in range(30):
        host.ask(b"f 0\n")
    assert not host.firmware.armed
    assert read(host, f"axis0.{name}") == str(bits)
    host.send(b"sc\n")
    host.wait(2)
    assert read(host, f"axis0.{name}") in ("0", str(bits) if firmware == "0.5" else "0")


def test_an_odrive_with_an_error_stays_idle_until_it_is_cleared(odrive: Opened) -> None:
    host = odrive("0.5")
    host.firmware.break_down(DriveFault.UNDERVOLTAGE)
    close_loop(host)
    assert not host.firmware.armed
    assert read(host, "axis0.motor.error") == str(1 << 24)
    host.send(b"sc\n")
    host.wait(2)
    close_loop(host)
    assert host.firmware.armed


def test_simplefoc_speaks_as_it_is_told_to(simplefoc: Opened) -> None:
    host = simplefoc(current_limit=9.0)
    assert host.ask(b"?\n") == b"M:motor\r\n"
    assert host.ask(b"M0.5\n") == b"Target: 0.500\r\n"
    assert host.ask(b"@1\n") == b"on!\r\n"
    assert host.ask(b"#4\n") == b"4\r\n"
    assert host.ask(b"MT2\n") == b"foc curr\r\n"
    assert host.ask(b"MC0\n") == b"torque\r\n"
    assert host.ask(b"MLC1.5\n") == b"1.5000\r\n"
    assert host.ask(b"MZ\n") == b"err\r\n"
    host.send(b"M3\n")
    host.wait(30)
    assert host.current_a == pytest.approx(1.5, rel=0.02)
    told = [float(each) for each in host.ask(b"MMG7\n").decode().split(";")]
    assert told[0] == 3.0
    assert told[3] == pytest.approx(1.5, abs=0.05)
    assert told[6] > 0
    assert host.ask(b"ME0\n") == b"0\r\n"
    assert not host.firmware.armed
    assert host.ask(b"@0\nME\n") == b""


def test_simplefoc_by_voltage_meets_the_back_emf(simplefoc: Opened) -> None:
    host = simplefoc("1", "10 A", mode="voltage", supply=12.0)
    for text in ("@1", "MT0", "MC0", "MLU12", "ME1", "M3"):
        host.ask(f"{text}\n".encode())
    host.wait(5)
    first_a = host.current_a
    host.wait(300)
    assert 0 < host.current_a < 0.95 * first_a


def test_simplefocs_timeout_is_the_sketchs(simplefoc: Opened) -> None:
    for watchdog_s, armed in ((0.2, False), (0.0, True)):
        host = simplefoc(current_limit=9.0, watchdog=watchdog_s)
        for text in ("MC0", "MT2", "ME1", "M0.1"):
            host.ask(f"{text}\n".encode())
        for _ in range(60):
            host.ask(b"MMG7\n")
        assert host.firmware.armed is armed
