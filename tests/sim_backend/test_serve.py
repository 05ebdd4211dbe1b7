"""The simulated devices in wall time: another process meets them through real sockets and pseudo-terminals."""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from random import SystemRandom

import can
import cantools
import numpy as np
import odrive_can
import pytest

from norton_drivers.bota import open_torque_sensor
from norton_drivers.dyn200 import open_torque_sensor as open_dyn200
from norton_drivers.errors import ConnectionFailedError, DeviceTimeoutError, WiringError
from norton_drivers.hardware import open_backend
from norton_drivers.link import Link, wait_until
from norton_drivers.odrive import open_amplifier
from norton_drivers.readings import DriveState
from norton_drivers.wiring import CanBusSettings, DeviceSettings, Wiring
from norton_sim.serve import serve
from norton_sim.served_ports import ServedPort

DBC = cantools.database.load_file(Path(odrive_can.__file__).parent / "dbc" / "odrive-cansimple-0.6.10.dbc")

NOWHERE = {"seed": None, "place": ""}

# The server's own process: it is told the wiring, and says when it is ready.
SERVER = """
import pickle, sys
from norton_sim.serve import serve

wiring, simulated = pickle.load(sys.stdin.buffer)
try:
    serve(wiring, simulated, seed=1, place="rig.toml", on_ready=lambda: print("ready", flush=True), stop=lambda: False)
except KeyboardInterrupt:
    sys.exit(130)
"""


@contextmanager
def serving(wiring: Wiring, simulated: dict[str, object]) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        server.stdin.write(pickle.dumps((wiring, simulated)))
        server.stdin.close()
        assert server.stdout.readline() == b"ready\n"
        try:
            yield server
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait(10)


SET_UP_OTHERWISE = {"load": {"bitrate": "500 kbit/s"}, "torque_sensor": {"baud": 115_200}}


def own_group() -> str:
    """A multicast group that no other test is likely to have."""
    return "239.74." + ".".join(str(SystemRandom().randrange(1, 255)) for _ in range(2))


def patient(drive: DeviceSettings) -> DeviceSettings:
    """With a watchdog that sits out what a busy computer stands still for."""
    return replace(drive, options={**drive.options, "watchdog": 2.0})


@pytest.fixture(params=["udp_multicast", "slcan"])
def served_wiring(request: pytest.FixtureRequest, wiring: Wiring, tmp_path: Path) -> Wiring:
    channel = own_group() if request.param == "udp_multicast" else str(tmp_path / "ports" / "can0")
    assert wiring.torque_sensor is not None
    assert wiring.load is not None
    return replace(
        wiring,
        actuator=patient(wiring.actuator),
        load=patient(wiring.load),
        buses=(CanBusSettings("can0", request.param, channel),),
        torque_sensor=replace(wiring.torque_sensor, port=str(tmp_path / "ports" / "bota")),
    )


@pytest.mark.long
@pytest.mark.wall_time
def test_another_process_enables_both_drives_and_streams(
    served_wiring: Wiring, simulated: dict[str, object], tmp_path: Path
) -> None:
    with serving(served_wiring, simulated) as server:
        backend = open_backend(served_wiring, {}, seed=None, place="")
        link = Link(backend, served_wiring.buses)
        assert served_wiring.load is not None
        drives = open_amplifier(served_wiring.actuator, link), open_amplifier(served_wiring.load, link)
        sensor = open_torque_sensor(served_wiring.torque_sensor, link)
        try:
            for drive in drives:
                drive.identify()
                drive.enable()
            for drive in drives:
                drive.take_motion()
            sensor.take_torque()
            start_ns = backend.clock.now_ns()
            for tick in range(1, 1001):
                backend.clock.wait_until_ns(start_ns + tick * 1_000_000)
                link.poll()
                drives[0].command(0.1)
                drives[1].command(0.0)
            motion, load_motion, torque = drives[0].take_motion(), drives[1].take_motion(), sensor.take_torque()
            assert [drive.status().state for drive in drives] == [DriveState.ENABLED] * 2
            assert [drive.malformed for drive in drives] == [0, 0]
            # A second of wall time is a second of the plant's. The machine may stall for tens of milliseconds.
            elapsed_ms = (backend.clock.now_ns() - start_ns) * 1e-6
            for readings in (motion, load_motion, torque):
                assert len(readings) == pytest.approx(elapsed_ms, rel=0.1)
            assert motion[-1].velocity_rad_s == pytest.approx(load_motion[-1].velocity_rad_s, rel=0.05)
            assert motion[-1].velocity_rad_s > 20
            # The sensor's own clock runs with the wall's.
            line = np.polyfit([each.device_ns for each in torque], [each.arrival_ns for each in torque], 1)
            assert line[0] == pytest.approx(1, abs=0.05)
        finally:
            for drive in drives:
                drive.stop()
            time.sleep(0.05)
            backend.close()
    assert server.returncode == 130
    assert not any(os.path.lexists(tmp_path / "ports" / name) for name in ("bota", "can0"))


@pytest.mark.long
@pytest.mark.wall_time
def test_a_sensor_that_has_to_be_asked_is_asked_from_another_process(
    wiring: Wiring, simulated: dict[str, object], tmp_path: Path
) -> None:
    options = {"mode": "polled", "torque_per_digit": 1e-3, "station": 9}
    sensor_settings = DeviceSettings("torque_sensor", "dyn200", port=str(tmp_path / "dyn200"), options=options)
    wiring = replace(
        wiring, buses=(CanBusSettings("can0", "udp_multicast", own_group()),), torque_sensor=sensor_settings
    )
    with serving(wiring, simulated):
        link = Link(open_backend(wiring, {}, seed=None, place=""), ())
        try:
            sensor = open_dyn200(sensor_settings, link)
            assert sensor.identify(timeout_s=5).hardware == "3 decimals"
            sensor.take_torque()
            for _ in range(500):
                link.wait()
            readings = sensor.take_torque()
        finally:
            link.close()
    assert len(readings) > 30
    # Bias and noise, in whole digits.
    assert np.mean([reading.torque_nm for reading in readings]) == pytest.approx(3e-3, abs=1e-3)
    assert all(abs(reading.torque_nm * 1e3 - round(reading.torque_nm * 1e3)) < 1e-9 for reading in readings)


@pytest.mark.long
@pytest.mark.wall_time
def test_any_python_can_program_hears_it(wiring: Wiring, simulated: dict[str, object], tmp_path: Path) -> None:
    assert wiring.torque_sensor is not None
    wiring = replace(
        wiring,
        buses=(CanBusSettings("can0", "udp_multicast", own_group()),),
        torque_sensor=replace(wiring.torque_sensor, port=str(tmp_path / "bota")),
    )
    with serving(wiring, simulated), can.Bus(wiring.buses[0].channel, "udp_multicast") as bus:
        bus.send(can.Message(arbitration_id=2 << 5, is_remote_frame=True, dlc=8, is_extended_id=False))
        heard: dict[int, bytes] = {}
        deadline = time.monotonic() + 5
        while {1 << 5 | 1, 2 << 5 | 1, 2 << 5} - heard.keys() and time.monotonic() < deadline:
            message = bus.recv(0.2)
            if message is not None and not message.is_remote_frame:
                heard[message.arbitration_id] = bytes(message.data)
    for node in (1, 2):
        heartbeat = DBC.decode_message("Axis0_Heartbeat", heard[node << 5 | 1], decode_choices=False)
        assert (heartbeat["Axis_Error"], heartbeat["Axis_State"]) == (0, 1)
    assert DBC.decode_message("Axis0_Get_Version", heard[2 << 5])["Fw_Version_Minor"] == 6


@pytest.mark.long
@pytest.mark.wall_time
def test_faults_happen_in_wall_time(served_wiring: Wiring, simulated: dict[str, object]) -> None:
    faults = [
        {"kind": "unplugged", "on": "torque_sensor", "at": "1.5 s"},
        {"kind": "dropout", "on": "load", "at": "500 ms", "for": "500 ms"},
    ]
    with (
        serving(served_wiring, {**simulated, "fault": faults}),
        closing(open_backend(served_wiring, {}, **NOWHERE)) as host,
    ):
        link = Link(host, served_wiring.buses)
        load = open_amplifier(served_wiring.load, link)
        open_torque_sensor(served_wiring.torque_sensor, link)
        with pytest.raises(ConnectionFailedError, match="bota: lost"):
            wait_until(lambda: False, link, timeout_s=10)
        gaps_ns = np.diff([reading.arrival_ns for reading in load.take_motion()])
        # This machine may stall for a while; it does not for half a second, or just once.
        assert 400e6 < max(gaps_ns) < 1000e6
        assert sum(gaps_ns > 400e6) == 1


def test_a_host_of_its_own_cannot_be_stalled(wiring: Wiring, simulated: dict[str, object], tmp_path: Path) -> None:
    assert wiring.torque_sensor is not None
    wiring = replace(
        wiring,
        buses=(CanBusSettings("can0", "slcan", str(tmp_path / "can0")),),
        torque_sensor=replace(wiring.torque_sensor, port=str(tmp_path / "bota")),
    )
    stalled = {**simulated, "fault": [{"kind": "host-stall", "for": "1 s"}]}
    with pytest.raises(WiringError, match="the host is another process here"):
        serve(wiring, stalled, seed=1, place="rig.toml", on_ready=lambda: None, stop=lambda: True)
    assert list(tmp_path.iterdir()) == []


def test_a_witness_that_cannot_be_written_is_said_so(
    wiring: Wiring, simulated: dict[str, object], tmp_path: Path
) -> None:
    assert wiring.torque_sensor is not None
    wiring = replace(
        wiring,
        buses=(CanBusSettings("can0", "slcan", str(tmp_path / "can0")),),
        torque_sensor=replace(wiring.torque_sensor, port=str(tmp_path / "bota")),
    )
    witness = tmp_path / "nowhere" / "truth.csv"
    with pytest.raises(WiringError, match=r"truth.csv: cannot be written \(No such file or directory\)"):
        serve(wiring, simulated, seed=1, place="", on_ready=lambda: None, stop=lambda: True, witness=witness)


def test_a_port_is_a_link_that_goes_away(tmp_path: Path) -> None:
    path = tmp_path / "new" / "port"
    port = ServedPort(str(path))
    emulated = os.open(path, os.O_RDWR | os.O_NOCTTY)
    port.write(b"\x00\n\r\xff")
    assert os.read(emulated, 10) == b"\x00\n\r\xff"
    os.write(emulated, b"\x03\x04\r")
    assert port.read() == b"\x03\x04\r"
    assert port.read() == b""
    os.close(emulated)
    port.write(b"nobody listens")
    port.close()
    assert not path.is_symlink()


def test_a_full_line_loses_bytes_and_does_not_block(tmp_path: Path) -> None:
    """It returns: a line that nobody reads holds a few kilobytes, and a million are written."""
    port = ServedPort(str(tmp_path / "port"))
    for _ in range(1000):
        port.write(bytes(1000))
    port.close()


def test_what_stands_in_the_way_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.write_text("mine")
    with pytest.raises(ConnectionFailedError, match="something stands there"):
        ServedPort(str(path))
    assert path.read_text() == "mine"
    elsewhere = tmp_path / "link"
    elsewhere.symlink_to(path)
    with pytest.raises(ConnectionFailedError, match="something stands there"):
        ServedPort(str(elsewhere))


def test_a_second_server_is_refused_and_a_dead_ones_link_replaced(tmp_path: Path) -> None:
    path = tmp_path / "port"
    first = ServedPort(str(path))
    with pytest.raises(ConnectionFailedError, match="another server"):
        ServedPort(str(path))
    first.close()
    path.symlink_to("/dev/pts/999999")
    ServedPort(str(path)).close()
    assert not path.is_symlink()


def test_closing_leaves_a_link_that_became_anothers(tmp_path: Path) -> None:
    path = tmp_path / "port"
    port = ServedPort(str(path))
    path.unlink()
    path.symlink_to("/dev/null")
    port.close()
    assert path.is_symlink()


@pytest.mark.parametrize("path", ["/proc/nowhere/port", "/proc/port"])
def test_a_port_that_cannot_be_made_is_said_so(path: str) -> None:
    with pytest.raises(ConnectionFailedError, match="cannot make it"):
        ServedPort(path)


@pytest.mark.long
@pytest.mark.wall_time
@pytest.mark.parametrize("served_wiring", ["slcan"], indirect=True)
def test_an_slcan_adapters_flags_and_a_sensor_at_another_baud(
    served_wiring: Wiring, simulated: dict[str, object]
) -> None:
    wrong = {role: {**simulated[role], "device": device} for role, device in SET_UP_OTHERWISE.items()}  # type: ignore[dict-item]
    with serving(served_wiring, {**simulated, **wrong}):
        backend = open_backend(served_wiring, {}, seed=None, place="")
        link = Link(backend, served_wiring.buses)
        drive = open_amplifier(served_wiring.actuator, link)
        assert drive.identify(timeout_s=5).firmware == "0.6.10"
        for _ in range(3):
            link.ask_adapters()
            link.wait(50_000_000)
        assert link.troubles()["bus can0", "bus error"] >= 1
        assert served_wiring.torque_sensor is not None
        for baud, understood in ((460_800, False), (115_200, True)):
            settings = replace(served_wiring.torque_sensor, options={"axis": "z", "baud": baud})
            tried = Link(backend, ())
            sensor = open_torque_sensor(settings, tried)
            if understood:
                assert sensor.identify(timeout_s=5).driver == "bota"
            else:
                with pytest.raises(DeviceTimeoutError):
                    sensor.identify()
            tried.close()
        link.close()
        backend.close()
