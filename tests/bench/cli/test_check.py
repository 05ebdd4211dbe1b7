"""``rig check`` and ``devices`` as commands: what is printed for whom, and the exit codes."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode
from norton_drivers import discovery
from norton_drivers.discovery import FoundPort

RIG = Path(__file__).parents[3] / "rigs" / "sim-odrive.toml"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: object) -> tuple[int, str, str]:
        code = app.main([str(each) for each in arguments])
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    return run


@pytest.fixture
def rig_with(tmp_path: Path) -> Callable[..., Path]:
    """``rig_with(role=device)``: the shipped rig, of which a device is really set up otherwise."""

    def make(**devices: str) -> Path:
        text = RIG.read_text()
        for role, device in devices.items():
            text = text.replace(f"[simulated.{role}]", f"[simulated.{role}]\ndevice = {device}", 1)
        path = tmp_path / "rig.toml"
        path.write_text(text)
        return path

    return make


def test_a_bench_in_order_in_words(run: Run) -> None:
    code, out, err = run("rig", "check", RIG)
    assert (code, err) == (ExitCode.OK, "")
    assert "actuator: odrive, can0 node 1, hardware 4.4.58, firmware 0.6.10, answers in 0." in out
    assert "bus can0: udp_multicast on 239.74.163.2, 22" in out
    assert "  an ODrive at node = 1, [actuator]: heartbeat, " in out


def test_a_bench_in_order_for_programs(run: Run) -> None:
    code, out, _ = run("rig", "check", RIG, "--json", "--move")
    found: dict[str, Any] = json.loads(out)
    assert code == ExitCode.OK
    assert list(found) == ["devices", "buses", "lines", "host", "moved", "problems", "remarks", "identify"]
    assert [(device["role"], device["problems"]) for device in found["devices"]] == [
        ("actuator", []),
        ("load", []),
        ("torque_sensor", []),
    ]
    (bus,) = found["buses"]
    assert (bus["name"], bus["interface"], bus["troubles"], bus["unknown"]) == ("can0", "udp_multicast", {}, [])
    assert [sender["options"] for sender in bus["senders"]] == [{"node": 1}, {"node": 2}]
    assert (found["host"], found["problems"], found["identify"]) == (None, [], None)
    assert any("the load gives about 0.9" in said for said in found["moved"])


@pytest.mark.parametrize(
    ("devices", "code", "sentence"),
    [
        (
            {"actuator": "{ node = 5 }"},
            ExitCode.TIMEOUT,
            "nobody is heard at node = 1, but an ODrive at node = 5 (heartbeat): set node = 5",
        ),
        (
            {"torque_sensor": "{ baud = 115200 }"},
            ExitCode.TIMEOUT,
            "it speaks at 115200 baud, not at 460800: set baud = 115200",
        ),
        (
            {"load": '{ bitrate = "500 kbit/s" }'},
            ExitCode.TIMEOUT,
            "only [actuator] can be heard, and errors (bus error ",
        ),
        (
            {"load": '{ bitrate = "500 kbit/s" }', "actuator": '{ bitrate = "500 kbit/s" }'},
            ExitCode.TIMEOUT,
            "bitrate = 1000000 bit/s is probably not the devices'",
        ),
        ({"torque_sensor": "{ plugged = false }"}, ExitCode.TIMEOUT, "(0 bytes that are none); check power"),
        (
            {"load": "{ node = 1 }"},
            ExitCode.EXPERIMENT_FAILED,
            "two devices share the address of [actuator] (each question has two answers)",
        ),
    ],
)
def test_what_is_wrong_is_a_sentence_and_an_exit_code(
    run: Run, rig_with: Callable[..., Path], devices: dict[str, str], code: ExitCode, sentence: str
) -> None:
    path = rig_with(**devices)
    ended, out, err = run("rig", "check", path, "--json")
    assert ended == code
    assert any(sentence in line and line.startswith(f"{path}: ") for line in err.splitlines())
    assert any(sentence in problem for problem in json.loads(out)["problems"])


def test_a_swapped_sign_needs_motion(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG.read_text().replace("mounted = 1\n", "mounted = -1\n"))
    assert run("rig", "check", path)[0] == ExitCode.OK
    code, _, err = run("rig", "check", path, "--move")
    assert code == ExitCode.EXPERIMENT_FAILED
    announced, sentence = err.splitlines()
    assert announced.startswith("moving: pushes that grow to at most 0.25 N*m")
    assert "reverse [torque_sensor] direction in the rig file" in sentence


def test_devices(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    found = (
        FoundPort("serial", "/dev/serial/by-id/usb-CANable", "CANable2", "/dev/ttyACM0", "16d0:117e", "slcan"),
        FoundPort("socketcan", "can0", "CAN link of the kernel", "can0", mend="it is down: `sudo ip link ...`"),
    )
    monkeypatch.setattr(discovery, "list_ports", lambda: found)
    code, out, _ = run("devices")
    assert code == ExitCode.OK
    assert out.splitlines() == [
        "serial (or slcan) /dev/serial/by-id/usb-CANable",
        "  CANable2 (16d0:117e), /dev/ttyACM0",
        "socketcan can0",
        "  CAN link of the kernel",
        "  it is down: `sudo ip link ...`",
    ]
    _, out, _ = run("devices", "--json")
    first, second = json.loads(out)["ports"]
    assert first == {
        "kind": "serial",
        "channel": "/dev/serial/by-id/usb-CANable",
        "description": "CANable2",
        "device": "/dev/ttyACM0",
        "usb": "16d0:117e",
        "interface": "slcan",
        "mend": None,
    }
    assert second["mend"] == "it is down: `sudo ip link ...`"


def test_no_devices(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "list_ports", tuple)
    assert run("devices")[1].startswith("Neither a serial port nor a CAN adapter was found")


@pytest.mark.parametrize(
    ("rig_name", "bitrate", "share"), [("sim-vesc", "400 kbit/s", "106%"), ("sim-odrive", "250 kbit/s", "106%")]
)
def test_a_bus_that_is_too_full_is_refused_by_all_in_the_same_words(
    rig_name: str, bitrate: str, share: str, run: Run, tmp_path: Path
) -> None:
    rig = tmp_path / "full.toml"
    text = RIG.with_name(f"{rig_name}.toml").read_text()
    rig.write_text(re.sub(r'(?m)^bitrate = ".*?"', f'bitrate = "{bitrate}"', text))
    code, out, err = run("rig", "check", str(rig))
    sentence = err.strip().removeprefix(f"{rig}: ")
    assert (code, sentence.partition(share)[0]) == (ExitCode.EXPERIMENT_FAILED, "bus can0: its devices send ")
    assert f"norton-bench identify would refuse this rig: {sentence}" in out
    assert "can run" not in out
    assert json.loads(run("rig", "check", str(rig), "--json")[1])["identify"] == sentence
    for asked in (("--dry-run",), ("--backend", "hardware", "--dry-run"), ("--out", str(tmp_path / "out"))):
        code, out, err = run("identify", str(rig), *asked)
        assert (code, out) == (ExitCode.EXPERIMENT_FAILED, "")
        assert sentence in err
    assert not (tmp_path / "out").exists()


def test_a_bench_that_is_not_in_order_is_not_said_to_be_ready(run: Run, rig_with: Callable[..., Path]) -> None:
    code, out, _ = run("rig", "check", rig_with(actuator="{ node = 5 }"))
    assert code == ExitCode.TIMEOUT
    assert "norton-bench identify can run on it once what was found is mended: tare" in out


def test_what_identify_would_refuse_is_told_and_is_no_problem_of_the_bench(run: Run, tmp_path: Path) -> None:
    """A rig may be for other sessions: its window is too narrow for the standard one."""
    rig = tmp_path / "narrow.toml"
    rig.write_text(Path(RIG).read_text().replace('position = "unlimited"  ', 'position = "0.01 rad"'))
    code, out, _ = run("rig", "check", str(rig), "--json")
    refusal = json.loads(out)["identify"]
    dry_code, _, said = run("identify", str(rig), "--dry-run")
    assert (code, dry_code) == (ExitCode.OK, ExitCode.USAGE)
    assert refusal in said
    assert "[limits] position is 0.01 rad" in refusal
