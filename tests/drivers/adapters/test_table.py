"""Every interface: mistakes told before anything is opened, and one sentence with the mend where it cannot be."""

import errno
import shutil
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import can
import pytest
from can.interfaces import BACKENDS

from norton_drivers.adapters import socketcan, steady_socketcan, table
from norton_drivers.adapters.mended_buses import ThreadedBus
from norton_drivers.adapters.socketcan import KernelLink
from norton_drivers.adapters.table import ADAPTERS, mistakes, open_bus
from norton_drivers.adapters.table import BITRATES as SLCAN_BITRATES
from norton_drivers.adapters.vendors import KvaserHealth, PcanHealth
from norton_drivers.errors import ConnectionFailedError
from norton_drivers.wiring import CanBusSettings

GOOD = {
    "socketcan": CanBusSettings("b", "socketcan", "can0", 500_000, {"fd": False}),
    "slcan": CanBusSettings("b", "slcan", "/dev/ttyACM0@2000000", 1_000_000),
    "gs_usb": CanBusSettings("b", "gs_usb", "0"),
    "pcan": CanBusSettings("b", "pcan", "PCAN_USBBUS1"),
    "kvaser": CanBusSettings("b", "kvaser", "1", options={"accept_virtual": False}),
    "fdcanusb": CanBusSettings("b", "fdcanusb", "/dev/ttyACM0", fd=True, data_bitrate_bit_s=5_000_000),
    "socketcand": CanBusSettings("b", "socketcand", "can0", options={"host": "10.0.0.1", "port": 29536}),
    "udp_multicast": CanBusSettings("b", "udp_multicast", "239.74.163.2", options={"port": 43113}),
    "virtual": CanBusSettings("b", "virtual", "any"),
    "vector": CanBusSettings("b", "vector", "0", options={"app_name": None}),
}


class StandIn(can.BusABC):
    """In the place of python-can's own class, by python-can's own table of interfaces."""

    opened_with: dict[str, object]
    failure: Callable[[], Exception] | None = None

    def __init__(self, channel: object, **options: object) -> None:
        StandIn.opened_with = {"channel": channel, **options}
        if StandIn.failure is not None:
            raise StandIn.failure()
        super().__init__(channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None: ...


@pytest.fixture
def stand_in(monkeypatch):
    """``stand_in(interface)``: python-can opens a StandIn; ``failure`` makes that raise."""
    monkeypatch.setattr(StandIn, "failure", None)

    def put(interface: str, failure: Callable[[], Exception] | None = None) -> CanBusSettings:
        monkeypatch.setattr(steady_socketcan, "SteadySocketcanBus", StandIn)
        monkeypatch.setitem(BACKENDS, interface, (__name__, "StandIn"))
        monkeypatch.setattr(can.interface, "_get_class_for_interface", lambda _name: StandIn)
        monkeypatch.setattr(StandIn, "failure", staticmethod(failure) if failure else None)
        return GOOD[interface]

    return put


@pytest.fixture
def no_obstacle(monkeypatch):
    """The kernel has CAN, and the link is up at the rig's bitrate."""
    monkeypatch.setattr(socketcan, "obstacle_of", lambda _settings: None)


# ---- Mistakes of the rig file --------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", GOOD.values(), ids=GOOD)
def test_what_is_right_is_left_alone(settings):
    assert list(mistakes(settings)) == []


def _socketcan(**options: object) -> CanBusSettings:
    return CanBusSettings("b", "socketcan", "can0", options=options)


@pytest.mark.parametrize(
    ("settings", "key", "words"),
    [
        (CanBusSettings("b", "slcan", "/dev/x", 800_000), "bitrate", "none that slcan adapters know: 10, 20, 50"),
        (CanBusSettings("b", "gs_usb", "can0"), "channel", '"0" is the first one found'),
        (CanBusSettings("b", "pcan", "usb1"), "channel", 'write it like "PCAN_USBBUS1"'),
        (CanBusSettings("b", "pcan", "PCAN_USBBUS1", 400_000), "bitrate", "none that PCAN-Basic knows"),
        (CanBusSettings("b", "kvaser", "can0"), "channel", "CANlib's number"),
        (CanBusSettings("b", "socketcand", "can0"), "options", 'add options = { host = "192.168.1.5", port = 29536 }'),
        (CanBusSettings("b", "socketcand", "can0", options={"host": "x"}), "options", "29536 is its default"),
        (CanBusSettings("b", "udp_multicast", "10.0.0.1"), "channel", "must be a multicast address"),
        (CanBusSettings("b", "udp_multicast", "somewhere"), "channel", "must be a multicast address"),
        (
            replace(GOOD["gs_usb"], fd=True),
            "fd",
            "gs_usb cannot carry CAN FD frames here; take another interface",
        ),
        (replace(GOOD["socketcand"], fd=True), "fd", "socketcand cannot carry CAN FD frames here"),
        (replace(GOOD["slcan"], fd=True, data_bitrate_bit_s=8_000_000), "data_bitrate", "write 2 Mbit/s or 5 Mbit/s"),
        (_socketcan(receive_own_messages=True), "options", "take its own frames"),
        (_socketcan(bitrate=5), "options", "a key of the section itself"),
        (_socketcan(local_lopback=True), "options", 'did you mean "local_loopback"?'),
    ],
)
def test_a_mistake_is_told_before_anything_is_opened(settings, key, words):
    ((where, text),) = mistakes(settings)
    assert where == key
    assert words in text


def test_an_option_that_only_a_newer_python_can_knows_passes():
    settings = CanBusSettings("b", "socketcan", "can0", options={"something_new": 1})
    assert list(mistakes(settings)) == []


def test_slcans_bitrates_are_python_cans():
    from can.interfaces.slcan import slcanBus

    assert sorted(slcanBus._BITRATES) == list(SLCAN_BITRATES)


# ---- What cannot be opened -----------------------------------------------------------------------------------------


def usb_error(number: int) -> OSError:
    return OSError(number, "usb")


class NoBackendError(ValueError):
    """As pyusb names it."""


@pytest.mark.parametrize(
    ("interface", "failure", "mend"),
    [
        (
            "socketcan",
            lambda: OSError(errno.ENETDOWN, "down"),
            "is it up? `sudo ip link set can0 up type can bitrate 500000`",
        ),
        ("gs_usb", lambda: can.CanInterfaceNotImplementedError("No module 'usb'"), 'pip install "python-can[gs_usb]"'),
        ("gs_usb", lambda: NoBackendError("No backend available"), "install libusb"),
        ("gs_usb", lambda: usb_error(errno.EACCES), "add a udev rule"),
        ("gs_usb", lambda: usb_error(errno.EBUSY), 'use interface = "socketcan"'),
        ("gs_usb", lambda: can.CanInitializationError("Cannot find device 0"), "norton-bench devices"),
        ("pcan", lambda: OSError("pcanbasic library not found."), "install PEAK's PCAN-Basic"),
        ("pcan", lambda: KeyError("PCAN_USBBUS99"), "norton-bench devices"),
        ("kvaser", lambda: NameError("name 'canGetNumberOfChannels' is not defined"), "install Kvaser's CANlib"),
        ("kvaser", lambda: can.CanInitializationError("no such channel"), "its channel's number"),
        ("vector", lambda: can.CanInterfaceNotImplementedError("only on Windows"), "library of the adapter's maker"),
        ("vector", RuntimeError, "cannot open it (RuntimeError)"),
    ],
)
def test_one_sentence_with_the_mend(stand_in, no_obstacle, interface, failure, mend):
    settings = stand_in(interface, failure)
    with pytest.raises(ConnectionFailedError) as caught:
        open_bus(settings)
    text = str(caught.value)
    assert text.startswith(f"[bus.b] {interface} on {settings.channel}: cannot open it (")
    assert mend in text
    assert "\n" not in text


def test_a_failure_is_told_once_and_by_us(stand_in, no_obstacle, caplog):
    with pytest.raises(ConnectionFailedError):
        open_bus(GOOD["pcan"])  # python-can's own, whose library is not on this machine
    assert caplog.records == []


def test_an_interface_that_is_none():
    with pytest.raises(ConnectionFailedError, match=r"python-can has no such interface; known: .*socketcan"):
        open_bus(CanBusSettings("b", "nonsense", "x"))


# ---- What is opened ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interface", "opened_with"),
    [
        ("socketcan", {"channel": "can0", "bitrate": 500_000, "fd": False}),
        ("gs_usb", {"channel": 0, "bitrate": 1_000_000}),
        ("pcan", {"channel": "PCAN_USBBUS1", "bitrate": 1_000_000}),
        ("kvaser", {"channel": "1", "bitrate": 1_000_000, "accept_virtual": False}),
        ("vector", {"channel": "0", "bitrate": 1_000_000, "app_name": None}),
    ],
)
def test_python_can_is_handed_what_the_rig_file_says(stand_in, no_obstacle, interface, opened_with):
    opened = open_bus(stand_in(interface))
    try:
        assert StandIn.opened_with == opened_with
        assert isinstance(opened.bus, ThreadedBus if interface == "gs_usb" else StandIn)
        assert opened.adapter is ADAPTERS.get(interface, table.UNKNOWN)
        assert opened.health.off_bus is None
    finally:
        opened.bus.shutdown()


@pytest.mark.parametrize("interface", ["socketcan", "pcan", "kvaser", "vector"])
def test_python_can_is_told_of_can_fd(stand_in, no_obstacle, interface):
    settings = replace(stand_in(interface), fd=True, data_bitrate_bit_s=5_000_000, options={})
    points = {"sample_point": 66.0, "data_sample_point": 66.0} if interface in ("pcan", "kvaser") else {}
    open_bus(replace(settings, options=points)).bus.shutdown()
    told = {key: value for key, value in StandIn.opened_with.items() if key not in ("channel", "bitrate")}
    timing = told.pop("timing", None)
    assert told == {"fd": True, "data_bitrate": 5_000_000}
    if points:
        assert (timing.nom_bitrate, timing.data_bitrate) == (1_000_000, 5_000_000)
        assert (timing.nom_sample_point, timing.data_sample_point) == pytest.approx((66.0, 66.0), abs=4.0)


# ---- socketcan: what the kernel says -------------------------------------------------------------------------------


@pytest.fixture
def network(tmp_path):
    """A folder like /sys/class/net: eth0, can0 up, can1 and vcan0 down."""
    for name, kind, flags in (("eth0", "1", "0x1003"), ("can0", "280", "0x40c1"), ("can1", "280", "0x40c0")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
        (tmp_path / name / "flags").write_text(f"{flags}\n")
    virtual = tmp_path / "devices" / "virtual" / "vcan0"
    shutil.copytree(tmp_path / "can1", virtual)
    (tmp_path / "vcan0").symlink_to(virtual)
    return tmp_path


def test_can_links(network):
    assert socketcan.can_links(network) == {"can0": True, "can1": False, "vcan0": False}
    assert socketcan.can_links(network / "nowhere") == {}


@pytest.mark.parametrize(
    ("channel", "link", "words"),
    [
        ("can0", KernelLink(), None),
        ("can0", KernelLink(500_000, "ERROR-PASSIVE"), None),
        ("can0", KernelLink(500_000, "BUS-OFF"), "(bus-off); check bitrate, wiring and termination"),
        ("can0", KernelLink(250_000), "the link runs at 250000 bit/s, but the rig file says 500000"),
        ("can1", KernelLink(), "the link is down; `sudo ip link set can1 up type can bitrate 500000`"),
        ("vcan0", KernelLink(), "the link is down; `sudo ip link set vcan0 up`"),
        ("vcan1", KernelLink(), "`sudo ip link add vcan1 type vcan && sudo ip link set vcan1 up`"),
        ("can7", KernelLink(), "there is no CAN link can7 (there is: can0, can1, vcan0); is the adapter plugged in?"),
        ("eth0", KernelLink(), "there is no CAN link eth0"),
    ],
)
def test_obstacles_of_socketcan(network, monkeypatch, channel, link, words):
    monkeypatch.setattr(socketcan, "kernel_link", lambda _channel: link)
    found = socketcan.obstacle_of(CanBusSettings("b", "socketcan", channel, 500_000), network, has_sockets=True)
    assert (found is None) if words is None else (words in (found or ""))


@pytest.mark.parametrize(
    ("mtu", "rates", "words"),
    [
        ("72", (1_000_000, 5_000_000), None),
        ("16", (1_000_000, 5_000_000), "the link carries no CAN FD frames; `sudo ip link set can0 down` and `sudo ip "),
        ("72", (1_000_000, 2_000_000), "the link sends data at 2000000 bit/s, but the rig file says 5000000"),
        ("72", (None, None), None),
    ],
)
def test_obstacles_of_socketcan_with_can_fd(network, monkeypatch, mtu, rates, words):
    (network / "can0" / "mtu").write_text(f"{mtu}\n")
    link = KernelLink(rates[0], data_bitrate_bit_s=rates[1])
    monkeypatch.setattr(socketcan, "kernel_link", lambda _channel: link)
    found = socketcan.obstacle_of(replace(GOOD["fdcanusb"], interface="socketcan", channel="can0"), network, True)
    assert (found is None) if words is None else (words in (found or ""))
    if found:
        assert "up type can bitrate 1000000 dbitrate 5000000 fd on`" in found


def test_a_kernel_without_can(network):
    found = socketcan.obstacle_of(GOOD["socketcan"], network, has_sockets=False)
    assert found is not None
    assert "modprobe can_raw" in found


@pytest.mark.parametrize(
    ("answer", "link"),
    [
        (
            '[{"ifname":"can0","txqlen":10,"linkinfo":{"info_kind":"can","info_data":{"state":"ERROR-ACTIVE",'
            '"restart_ms":0,"bittiming":{"bitrate":500000}}}}]',
            KernelLink(500_000, "ERROR-ACTIVE", 10),
        ),
        ('[{"ifname":"vcan0","txqlen":1000,"linkinfo":{"info_kind":"vcan"}}]', KernelLink(queue_frames=1000)),
        ("[]", KernelLink()),
        ("7", KernelLink()),
        ("nonsense", KernelLink()),
    ],
)
def test_what_the_kernel_says_of_a_link(monkeypatch, answer, link):
    monkeypatch.setattr(socketcan.subprocess, "run", lambda *_args, **_named: SimpleNamespace(stdout=answer))
    assert socketcan.kernel_link("can0") == link


def test_no_ip_command_is_no_trouble(monkeypatch):
    def missing(*_args: object, **_named: object) -> None:
        raise FileNotFoundError("ip")

    monkeypatch.setattr(socketcan.subprocess, "run", missing)
    assert socketcan.kernel_link("can0") == KernelLink()


@pytest.mark.parametrize(
    ("link", "remark"),
    [
        (KernelLink(500_000, "ERROR-ACTIVE", 10), "`sudo ip link set can0 txqueuelen 100`"),
        (KernelLink(500_000, "ERROR-ACTIVE", 100), None),
        (KernelLink(queue_frames=10), None),
    ],
)
def test_a_queue_that_is_too_short_is_remarked(monkeypatch, link, remark):
    monkeypatch.setattr(socketcan, "kernel_link", lambda _channel: link)
    said = list(table.remarks(GOOD["socketcan"]))
    assert len(said) == (remark is not None)
    assert remark is None or remark in said[0]


# ---- How a bus fares -----------------------------------------------------------------------------------------------


def test_pcans_status_is_counted_as_it_rises():
    statuses = iter([0, 0x40, 0x40, 0, 0x40 | 0x10])
    health = PcanHealth(SimpleNamespace(status=lambda: next(statuses)))
    for _ in range(4):
        health.ask()
    assert (health.troubles(), health.off_bus) == ({"receive queue overrun, frames were lost": 1}, None)
    health.ask()
    assert health.troubles() == {"receive queue overrun, frames were lost": 2, "bus-off": 1}
    assert health.off_bus == "PCAN-Basic says bus-off"


def test_kvasers_overruns():
    health = KvaserHealth(SimpleNamespace(get_stats=lambda: SimpleNamespace(overruns=7)))
    health.ask()
    assert (health.troubles(), health.off_bus) == ({"receive overrun": 7}, None)
