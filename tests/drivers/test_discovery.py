"""What is plugged in: names that stay, what a device is in words, and what stands in its way."""

import can
import pytest
import serial.tools.list_ports
from serial.tools.list_ports_common import ListPortInfo

from norton_drivers import discovery
from norton_drivers.discovery import FoundPort, found_serial, held_back_words, list_ports, stable_path


def entry(device: str, vid: int | None = None, pid: int | None = None, description: str = "n/a") -> ListPortInfo:
    info = ListPortInfo(device, skip_link_detection=True)
    info.vid, info.pid, info.description = vid, pid, description
    return info


@pytest.fixture
def machine(tmp_path):
    """Two serial devices, one of them with a path that stays."""
    (tmp_path / "ttyACM0").write_text("")
    (tmp_path / "ttyUSB0").write_text("")
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-CANable-if00").symlink_to(tmp_path / "ttyACM0")
    return tmp_path


def test_an_slcan_adapter_is_known_by_its_numbers(machine):
    found = found_serial(entry(str(machine / "ttyACM0"), 0x16D0, 0x117E, "CANable2 b158aa7"), machine / "by-id")
    assert found == FoundPort(
        kind="serial",
        channel=str(machine / "by-id" / "usb-CANable-if00"),
        description="CANable2 b158aa7, CANable, slcan firmware",
        device=str(machine / "ttyACM0"),
        usb="16d0:117e",
        interface="slcan",
    )


def test_a_serial_port_that_says_nothing(machine):
    found = found_serial(entry("/dev/ttyS0"), machine / "by-id")
    assert found == FoundPort("serial", "/dev/ttyS0", "", "/dev/ttyS0")


def test_a_path_that_stays_only_where_there_is_one(machine):
    assert stable_path(str(machine / "ttyUSB0"), machine / "by-id") == str(machine / "ttyUSB0")
    assert stable_path(str(machine / "ttyUSB0"), machine / "nowhere") == str(machine / "ttyUSB0")


@pytest.mark.parametrize(("held_ms", "told"), [("16", True), ("1", False), ("", False)])
def test_ftdis_latency_is_told(machine, held_ms, told):
    timer = machine / "usb" / "ttyUSB0" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(held_ms)
    held_back = held_back_words(str(machine / "ttyUSB0"), machine / "usb")
    assert held_back == (f"it holds bytes back for up to 16 ms: `echo 1 | sudo tee {timer}`" if told else "")


def test_a_port_that_this_user_may_not_open(machine, monkeypatch):
    monkeypatch.setattr(discovery.os, "access", lambda _path, _mode: False)
    assert "usermod -aG dialout" in found_serial(entry(str(machine / "ttyUSB0")), machine).mend


def test_list_ports_names_what_a_rig_file_could(monkeypatch):
    detected = [
        {"interface": "kvaser", "channel": 0, "device_name": "Leaf Light", "serial": 123},
        {"interface": "virtual", "channel": "channel-1"},
        {"interface": "serial", "channel": "/dev/ttyS0"},
    ]
    monkeypatch.setattr(can, "detect_available_configs", lambda: detected)
    monkeypatch.setattr(serial.tools.list_ports, "comports", lambda: [entry("/dev/ttyS0")])
    monkeypatch.setattr(discovery, "can_links", lambda _network: {"can0": True, "can1": False})
    found = list_ports()
    assert [(each.kind, each.channel) for each in found] == [
        ("serial", "/dev/ttyS0"),
        ("socketcan", "can0"),
        ("socketcan", "can1"),
        ("kvaser", "0"),
    ]
    assert (found[1].mend, found[3].description) == ("", "Leaf Light 123")
    assert "sudo ip link set can1 up" in found[2].mend
