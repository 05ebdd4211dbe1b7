"""Devices that are not set up as the rig file says: what the host then hears, in simulated time and on real ports."""

from collections.abc import Callable
from typing import Any

import can
import pytest

from norton_drivers.codecs.odrive import MessageId, arbitration_id
from norton_drivers.errors import DeviceTimeoutError, WiringError
from norton_drivers.link import Link
from norton_drivers.ports import CanPort
from norton_drivers.registry import open_amplifier, open_torque_sensor
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend

Open = Callable[..., SimulatedBackend]


def with_device(simulated: dict[str, Any], role: str, **device: Any) -> dict[str, Any]:
    return {role: {**simulated[role], "device": device}}


def heard_on(backend: SimulatedBackend, wiring: Wiring, for_s: float = 0.2) -> tuple[CanPort, list[can.Message]]:
    port, heard = backend.open_can(wiring.buses[0]), list[can.Message]()
    port.subscribe(lambda message, _arrival_ns: heard.append(message))
    backend.clock.wait_until_ns(backend.clock.now_ns() + round(for_s * 1e9))
    port.poll()
    return port, heard


def heartbeats(messages: list[can.Message]) -> set[int]:
    return {each.arbitration_id >> 5 for each in messages if each.arbitration_id & 0x1F == MessageId.HEARTBEAT}


def test_a_device_as_the_rig_file_says(open_bench: Open, wiring: Wiring) -> None:
    port, heard = heard_on(open_bench(wiring), wiring)
    assert (heartbeats(heard), port.troubles()) == ({1, 2}, {})


def test_another_node(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    _, heard = heard_on(open_bench(wiring, **with_device(simulated, "actuator", node=5)), wiring)
    assert heartbeats(heard) == {5, 2}


def test_two_at_one_node_both_answer(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    backend = open_bench(wiring, **with_device(simulated, "load", node=1))
    port, heard = heard_on(backend, wiring)
    port.send(arbitration_id(1, MessageId.VERSION), b"", remote=True)
    backend.clock.wait_until_ns(backend.clock.now_ns() + 5_000_000)
    port.poll()
    assert [each.arbitration_id for each in heard].count(arbitration_id(1, MessageId.VERSION)) == 2


def test_a_device_that_is_not_plugged_in(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    _, heard = heard_on(open_bench(wiring, **with_device(simulated, "load", plugged=False)), wiring)
    assert heartbeats(heard) == {1}


def test_another_bitrate_is_errors_and_silence(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    backend = open_bench(wiring, **with_device(simulated, "load", bitrate="500 kbit/s"))
    port, heard = heard_on(backend, wiring)
    assert heartbeats(heard) == {1}
    assert port.troubles()["bus error"] > 100
    before = port.error_frames
    port.send(arbitration_id(2, MessageId.VERSION), b"", remote=True)
    backend.clock.wait_until_ns(backend.clock.now_ns() + 600_000)
    port.poll()
    assert port.error_frames > before


def test_the_rigs_own_bitrate_is_none_of_another(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    port, heard = heard_on(open_bench(wiring, **with_device(simulated, "load", bitrate="1 Mbit/s")), wiring)
    assert (heartbeats(heard), port.error_frames) == ({1, 2}, 0)


@pytest.mark.parametrize(("baud", "understood"), [(460_800, True), (115_200, False), (921_600, False)])
def test_another_baud_is_garbage(
    open_bench: Open, wiring: Wiring, simulated: dict[str, Any], baud: int, understood: bool
) -> None:
    backend = open_bench(wiring, **with_device(simulated, "torque_sensor", baud=baud))
    link = Link(backend, wiring.buses)
    assert wiring.torque_sensor is not None
    sensor = open_torque_sensor(wiring.torque_sensor, link)
    if understood:
        assert sensor.identify().driver == "bota"
        return
    with pytest.raises(DeviceTimeoutError, match=r"no frame in 1 s \([1-9]\d+ bytes that are none\)"):
        sensor.identify()


def test_a_device_of_another_kind(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    device = {"driver": "dbc", "bus": "can0", "counter": "Counter"}
    _, heard = heard_on(open_bench(wiring, **with_device(simulated, "torque_sensor", **device)), wiring)
    assert 0x321 in {each.arbitration_id for each in heard}


def test_quantities_are_written_as_in_the_rig_file(open_bench: Open, wiring: Wiring, simulated: dict[str, Any]) -> None:
    backend = open_bench(wiring, **with_device(simulated, "actuator", watchdog="250 ms"))
    link = Link(backend, wiring.buses)
    assert open_amplifier(wiring.actuator, link).identify().firmware == "0.6.10"


@pytest.mark.parametrize(
    ("role", "device", "sentence"),
    [
        ("load", {"node": 99}, r"rig.toml: \[simulated.load\] device: \[load\] node = 99: "),
        ("load", {"heartbeat": "5 V"}, r'rig.toml: \[simulated.load\] device heartbeat: "5 V" is not in s'),
        ("load", {"bitrate": "fast"}, r'rig.toml: \[simulated.load\] device bitrate: "fast" is not a quantity'),
        ("load", {"plugged": "no"}, r"rig.toml: \[simulated.load\] device plugged = 'no' should be true or false"),
        ("load", {"driver": "odriv"}, r"rig.toml: \[simulated.load\] device driver = 'odriv' is not installed; known"),
        ("load", {"bus": "can7"}, r"\[load\] bus = 'can7' is not a bus of this rig"),
        ("actuator", {"nodde": 1}, r"\[actuator\] nodde is not an option of driver \"odrive\""),
    ],
)
def test_a_wrong_set_up_is_told_with_its_place(
    open_bench: Open, wiring: Wiring, simulated: dict[str, Any], role: str, device: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(WiringError, match=sentence):
        open_bench(wiring, **with_device(simulated, role, **device))
