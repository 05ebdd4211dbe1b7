"""Rig files: what is right becomes SI numbers, and every mistake is told in a sentence with its place and the mend."""

from collections.abc import Callable
from math import inf, pi
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.errors import ExitCode, RigError, UsageError
from norton_bench.rig.files import toml
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.rig.rig import Command, Supervision
from norton_bench.session.schema import load_session
from norton_drivers.dbc_sensor import SHIPPED

RIGS = Path(__file__).parents[3] / "rigs"
GOOD = """\
[rig]
name = "bench-3"
rate = "500 Hz"
backend = "hardware"

[bus.can0]
interface = "socketcan"
channel = "can0"
bitrate = "500 kbit/s"
options = { fd = false }

[actuator]
driver = "odrive"
bus = "can0"
node = 1
watchdog = "100 ms"
command = { unit = "A", limit = "12 A", sent_as = "N*m" }

[load]
driver = "odrive"
bus = "can0"
node = 2
direction = -1
torque_limit = "1.5 N*m"

[torque_sensor]
driver = "bota"
port = "/dev/ttyUSB0"
axis = "z"
range = "2 N*m"

[limits]
torque = "1 N*m"
velocity = "600 rpm"
position = "2 turn"
power = "20 W"
temperature = "80 degC"
command_rate = "50 A/s"
stale_after = "8 ms"
stall_after = "40 ms"
twist = "20 deg"

[guard]
leave_out = ["current", "frozen torque"]
verify_watchdogs = false

[simulated]
anything = [1, 2]
"""


def mistakes_in(text: str, backend: str | None = None) -> list[str]:
    with pytest.raises(RigError) as refusal:
        parse_rig(text, place="r.toml", backend=backend)
    assert refusal.value.exit_code == ExitCode.USAGE
    return str(refusal.value).splitlines()


def test_quantities_become_si() -> None:
    rig = parse_rig(GOOD, place="r.toml")
    assert (rig.name, rig.backend, rig.tick_ns) == ("bench-3", "hardware", 2_000_000)
    assert (rig.command.unit, rig.command.limit) == ("A", 12.0)
    limits = rig.limits
    assert limits.velocity_rad_s == pytest.approx(20 * pi)
    assert limits.position_rad == pytest.approx(4 * pi)
    assert (limits.torque_nm, limits.load_torque_nm, limits.power_w, limits.temperature_c) == (1.0, 1.5, 20.0, 80.0)
    assert (limits.command_rate_per_s, limits.stale_after_ns, limits.stall_after_ns) == (50.0, 8_000_000, 40_000_000)
    assert limits.twist_rad == pytest.approx(pi / 9)


def test_how_the_bench_is_supervised() -> None:
    assert parse_rig(GOOD, place="r.toml").supervision == Supervision(("current", "frozen torque"), False)
    by_itself = GOOD.replace("[guard]\n", "").replace('leave_out = ["current", "frozen torque"]\n', "")
    without = parse_rig(by_itself.replace("verify_watchdogs = false\n", ""), place="r.toml")
    assert without.supervision == Supervision((), True)
    assert parse_rig(GOOD.replace('"20 deg"', '"unlimited"'), place="r.toml").limits.twist_rad == inf


def test_wiring_carries_buses_devices_and_their_options() -> None:
    wiring = parse_rig(GOOD, place="r.toml").wiring
    (bus,) = wiring.buses
    assert (bus.name, bus.interface, bus.channel, bus.bitrate_bit_s) == ("can0", "socketcan", "can0", 500_000)
    assert bus.options == {"fd": False}
    assert [device.role for device in wiring.devices()] == ["actuator", "load", "torque_sensor"]
    assert wiring.actuator.options == {"node": 1, "watchdog": 0.1}
    assert wiring.load is not None
    assert wiring.load.direction == -1
    assert wiring.torque_sensor is not None
    assert (wiring.torque_sensor.port, wiring.torque_sensor.options) == ("/dev/ttyUSB0", {"axis": "z", "range": 2.0})


MODULATOR = """
[modulator]
driver = "odrive"
bus = "can0"
node = 3
command = { unit = "N*m/rad", limit = "4 N*m/rad", lowest = "1 N*m/rad", sent_as = "N*m" }
"""


def test_a_second_drive_of_the_actuator_has_a_command_of_its_own() -> None:
    rig = parse_rig(GOOD + MODULATOR, place="r.toml")
    assert parse_rig(GOOD, place="r.toml").modulation is None
    assert rig.modulation == Command("N*m/rad", 4.0, 1.0, "N*m")
    assert rig.modulation.span == (1.0, 4.0)
    assert [device.role for device in rig.wiring.devices()] == ["actuator", "load", "torque_sensor", "modulator"]
    assert rig.wiring.modulator is not None
    assert rig.wiring.modulator.options == {"node": 3}
    assert rig.wiring.modulation_unit == "N*m/rad"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("node = 3", "node = 2", "r.toml: [modulator]: node 2 of bus can0 belongs to [load] already; every device "),
        ('"odrive"', '"odriv"', 'r.toml: [modulator] driver: "odriv" is not installed; did you mean "odrive"?'),
        ('bus = "can0"\n', "", "r.toml: [modulator]: is not connected; add bus = "),
        ("command = ", "commands = ", "r.toml: [modulator] command: is missing; add command = "),
        ("4 N*m/rad", "0.5 N*m/rad", "r.toml: [modulator] command: lowest = 1 N*m/rad is not below limit"),
        ("4 N*m/rad", "4 N*m", 'r.toml: [modulator.command] limit: "4 N*m" is not in N*m/rad'),
        ("node = 3", 'node = 3\nwatchdog = "3 ms"', "r.toml: [modulator] watchdog: 3 ms is less than two ticks"),
        ("[modulator]", "[modulater]", 'r.toml: [modulater]: unknown section; did you mean "modulator"?'),
    ],
)
def test_what_is_wrong_with_a_modulator_is_told(old: str, new: str, sentence: str) -> None:
    said = mistakes_in(GOOD + MODULATOR.replace(old, new, 1))
    assert any(each.startswith(sentence) for each in said), said


def test_what_is_unlimited_or_left_out_is_infinite() -> None:
    text = GOOD.replace('"2 turn"', '"unlimited"').replace('power = "20 W"\n', "").replace('"50 A/s"', '"unlimited"')
    limits = parse_rig(text, place="r.toml").limits
    assert (limits.position_rad, limits.power_w, limits.command_rate_per_s) == (inf, inf, inf)


def test_the_simulated_section_is_passed_on_unread() -> None:
    assert parse_rig(GOOD, place="r.toml").simulated == {"anything": [1, 2]}


def test_a_bus_with_can_fd() -> None:
    (bus, _) = load_rig(RIGS / "sim-moteus.toml").wiring.buses
    assert (bus.fd, bus.bitrate_bit_s, bus.data_bitrate_bit_s, bus.switches_bitrate) == (True, 10**6, 5 * 10**6, True)
    assert bus.rates == "1000000 bit/s (data 5000000 bit/s)"
    (classical,) = parse_rig(GOOD, place="r.toml").wiring.buses
    assert (classical.fd, classical.switches_bitrate, classical.rates) == (False, False, "500000 bit/s")


def test_the_backend_can_be_overridden() -> None:
    assert parse_rig(GOOD, place="r.toml", backend="simulated").backend == "simulated"


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_rigs_that_are_shipped_are_right(path: Path) -> None:
    for backend in ("simulated", "hardware"):
        rig = load_rig(path, backend=backend)
        assert rig.name == path.stem
        assert rig.text == path.read_text()


def test_a_dbc_file_beside_the_rig_file_is_found(tmp_path: Path) -> None:
    (tmp_path / "mine.dbc").write_text((SHIPPED / "torque-sensor.dbc").read_text())
    sensor = 'driver = "dbc"\nbus = "can0"\ndbc = "mine.dbc"\nrange = "2 N*m"\n'
    start, end = GOOD.index('driver = "bota"'), GOOD.index("\n[limits]")
    (tmp_path / "rig.toml").write_text(GOOD[:start] + sensor + GOOD[end:])
    device = load_rig(tmp_path / "rig.toml").wiring.torque_sensor
    assert device is not None
    assert device.options["dbc"] == str(tmp_path / "mine.dbc")


# What is written instead of what, and the one sentence that follows.
ONE_MISTAKE = {
    "unknown section": ("[simulated]", "[simulatd]", 'r.toml: [simulatd]: unknown section; did you mean "simulated"?'),
    "unknown key": (
        "stale_after",
        "stale_aftr",
        'r.toml: [limits] stale_aftr: unknown key; did you mean "stale_after"?',
    ),
    "unknown key far from any": (
        'rate = "500 Hz"',
        'rate = "500 Hz"\nzzz = 1',
        "r.toml: [rig] zzz: unknown key; known: backend, name, rate, shaft",
    ),
    "missing key": ('rate = "500 Hz"\n', "", 'r.toml: [rig] rate: is missing; add rate = "1 kHz"'),
    "bad name": (
        '"bench-3"',
        '"../x"',
        'r.toml: [rig] name: expected a plain name of letters, digits, ".", "_" and "-", not "../x"; '
        'write it like "my-bench"',
    ),
    "unknown check": (
        '"frozen torque"',
        '"frozen_torque"',
        'r.toml: [guard] leave_out 2: "frozen_torque" is no plausibility check; did you mean "frozen torque"?',
    ),
    "unknown key of the guard": (
        "verify_watchdogs",
        "verify_watchdog",
        'r.toml: [guard] verify_watchdog: unknown key; did you mean "verify_watchdogs"?',
    ),
    "no unit": ('"8 ms"', "8", 'r.toml: [limits] stale_after: "8" has no unit; write it like "1 s"'),
    "wrong unit": ('"600 rpm"', '"600 Hz"', 'r.toml: [limits] velocity: "600 Hz" is not in rad/s'),
    "wrong unit of command": ('"12 A"', '"12 V"', 'r.toml: [actuator.command] limit: "12 V" is not in A'),
    "wrong unit of rate": ('"50 A/s"', '"50 N*m/s"', 'r.toml: [limits] command_rate: "50 N*m/s" is not in (A)/s'),
    "no such unit": ('unit = "A"', 'unit = "amp"', 'r.toml: [actuator.command] unit: "amp" is not a unit known here'),
    "wrong type": ('name = "bench-3"', "name = 3", "r.toml: [rig] name: expected a text in quotes, not 3"),
    "direction": ("direction = -1", "direction = 2", "r.toml: [load] direction: 2 is not allowed; write 1 or -1"),
    "negative limit": ('"600 rpm"', '"-6 rpm"', 'r.toml: [limits] velocity: "-6 rpm" must be greater than 0'),
    "empty position window": ('"2 turn"', '"0 rad"', 'r.toml: [limits] position: "0 rad" must be greater than 0'),
    "too fast": ('"500 Hz"', '"20 kHz"', 'r.toml: [rig] rate: "20 kHz" must be at most 5000'),
    "unknown driver": (
        'driver = "bota"',
        'driver = "boto"',
        'r.toml: [torque_sensor] driver: "boto" is not installed; did you mean "bota"?',
    ),
    "unknown option": ("axis =", "axes =", 'r.toml: [torque_sensor] axes: unknown key; did you mean "axis"?'),
    "wrong option": ('axis = "z"', 'axis = "q"', 'r.toml: [torque_sensor] axis: "q" is not allowed; write'),
    "wrong unit of option": ('"2 N*m"', '"2 N"', 'r.toml: [torque_sensor] range: "2 N" is not in N*m'),
    "missing option": ("node = 1\n", "", "r.toml: [actuator] node: is missing; add node ="),
    "unknown interface": (
        '"socketcan"',
        '"socketcn"',
        'r.toml: [bus.can0] interface: "socketcn" is no interface of python-can; did you mean "socketcan"?',
    ),
    "data bitrate without CAN FD": (
        'bitrate = "500 kbit/s"',
        'bitrate = "500 kbit/s"\ndata_bitrate = "2 Mbit/s"',
        "r.toml: [bus.can0] data_bitrate: is of CAN FD alone; write fd = true, or leave it out",
    ),
    "data bitrate below the other": (
        'bitrate = "500 kbit/s"',
        'bitrate = "500 kbit/s"\nfd = true\ndata_bitrate = "250 kbit/s"',
        "r.toml: [bus.can0] data_bitrate: is below bitrate; the data of CAN FD go at least as fast as the rest",
    ),
    "no CAN FD on this interface": (
        'interface = "socketcan"\nchannel = "can0"\nbitrate = "500 kbit/s"\noptions = { fd = false }',
        'interface = "gs_usb"\nchannel = "0"\nfd = true',
        "r.toml: [bus.can0] fd: gs_usb cannot carry CAN FD frames here; take another interface: socketcan, slcan, ",
    ),
    "a device that needs CAN FD": (
        'driver = "odrive"\nbus = "can0"\nnode = 2',
        'driver = "moteus"\nbus = "can0"\nnode = 2',
        'r.toml: [bus.can0] fd: [load] driver = "moteus" sends CAN FD frames; write fd = true and data_bitrate = "5 ',
    ),
    "unknown backend": (
        '"hardware"',
        '"hardwear"',
        'r.toml: [rig] backend: "hardwear" is not installed; did you mean "hardware"?',
    ),
    "not connected": (
        'port = "/dev/ttyUSB0"\n',
        "",
        'r.toml: [torque_sensor]: is not connected; add bus = "can0" or port = "/dev/ttyUSB0"',
    ),
    "connected twice": (
        'port = "/dev/ttyUSB0"',
        'port = "/dev/ttyUSB0"\nbus = "can0"',
        "r.toml: [torque_sensor]: is on a bus and on a port at once; leave out one of them",
    ),
    "undefined bus": (
        'bus = "can0"\nnode = 2',
        'bus = "can1"\nnode = 2',
        'r.toml: [load] bus: "can1" is not defined (known: can0); add a section [bus.can1]',
    ),
    "unused bus": (
        "[actuator]",
        '[bus.can1]\ninterface = "slcan"\nchannel = "x"\n\n[actuator]',
        "r.toml: [bus.can1]: no device is on this bus; remove the section, or name the bus in a device",
    ),
    "same node twice": (
        "node = 2",
        "node = 1",
        "r.toml: [load]: node 1 of bus can0 belongs to [actuator] already; every device needs an address of its own",
    ),
    "stale before two ticks": (
        '"8 ms"',
        '"3 ms"',
        'r.toml: [limits] stale_after: 3 ms is less than two ticks at the rate of 500 Hz; write at least "4 ms"',
    ),
    "stall beyond watchdog": (
        '"40 ms"',
        '"100 ms"',
        "r.toml: [limits] stall_after: 100 ms is not below the watchdog of [actuator], 100 ms; "
        "shorten stall_after or lengthen the watchdog",
    ),
    "a lost answer": (
        'driver = "bota"\nport = "/dev/ttyUSB0"\naxis = "z"',
        'driver = "mantracourt"\nport = "/dev/ttyUSB0"\nscale = 0.001\naveraging = "2 ms"\ntimeout = "8 ms"',
        "r.toml: [torque_sensor] timeout: 8 ms is not below [limits] stale_after = 8 ms: one lost answer would end the "
        "experiment; shorten timeout or lengthen stale_after",
    ),
    "torque beyond sensor": (
        'torque = "1 N*m"',
        'torque = "3 N*m"',
        "r.toml: [limits] torque: 3 N*m is beyond the sensor's range of 2 N*m; lower the limit",
    ),
    "no torque limit": ('torque = "1 N*m"\n', "", "r.toml: [limits] torque: is missing; add torque ="),
    "load beyond sensor": (
        '"1.5 N*m"',
        '"2.5 N*m"',
        "r.toml: [load] torque_limit: 2.5 N*m is beyond the sensor's range of 2 N*m; lower the limit",
    ),
    "clamped with a load": (
        'backend = "hardware"',
        'backend = "hardware"\nshaft = "clamped"',
        'r.toml: [rig] shaft: "clamped" contradicts the [load] that turns the shaft; leave out shaft, or [load]',
    ),
}


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    ONE_MISTAKE.values(),
    ids=ONE_MISTAKE.keys(),
)
def test_one_mistake_gives_one_sentence(right: str, wrong: str, said: str) -> None:
    assert GOOD.count(right) >= 1
    (sentence,) = mistakes_in(GOOD.replace(right, wrong, 1))
    assert sentence.startswith(said)


def without(section: str) -> str:
    return "\n\n".join(part for part in GOOD.split("\n\n") if not part.startswith(f"[{section}]"))


@pytest.mark.parametrize("section", ["rig", "actuator", "limits"])
def test_a_missing_section_is_named_with_what_to_add(section: str) -> None:
    said = [line for line in mistakes_in(without(section)) if line.startswith(f"r.toml: [{section}]: is missing")]
    assert len(said) == 1
    assert f"add [{section}] with" in said[0]


@pytest.mark.parametrize("section", ["rig", "bus", "load", "guard", "simulated"])
def test_a_value_where_a_section_belongs_is_told(section: str) -> None:
    text = f"{section} = 3\n" + "\n\n".join(part for part in GOOD.split("\n\n") if not part.startswith(f"[{section}"))
    assert any(line.startswith(f"r.toml: [{section}]: is a section") for line in mistakes_in(text))


def test_a_load_without_a_torque_sensor_needs_a_limit_of_its_own() -> None:
    said = mistakes_in(without("torque_sensor").replace("torque_limit", "# torque_limit"))
    missing = '[load] torque_limit: is missing, and no sensor watches the torque; add torque_limit = "1 N*m"'
    assert f"r.toml: {missing}" in said


def test_a_torque_limit_needs_a_torque_sensor() -> None:
    alone = "\n\n".join(part for part in without("torque_sensor").split("\n\n") if not part.startswith("[load]"))
    said = mistakes_in(alone)
    assert [line.split(":")[1].strip() for line in said] == ["[limits] torque", "[limits] power", "[limits] twist"]


def test_simulation_needs_its_section() -> None:
    (said,) = mistakes_in(without("simulated"), backend="simulated")
    assert said.startswith('r.toml: [simulated]: is missing though the backend is "simulated"')


def test_a_torque_command_must_stay_within_the_torque_limit() -> None:
    text = GOOD.replace('unit = "A", limit = "12 A"', 'unit = "mNm", limit = "1200 mNm"').replace("50 A/s", "50 mNm/s")
    (said,) = mistakes_in(text)
    assert said.startswith("r.toml: [actuator.command] limit: 1.2 N*m on a blocked shaft would exceed [limits] torque")


def test_all_mistakes_are_told_at_once() -> None:
    text = GOOD.replace("stale_after", "stale").replace('"600 rpm"', "6").replace("node = 2", "node = 99")
    assert len(mistakes_in(text.replace('"socketcan"', '"can"'))) == 4


def test_a_syntax_error_has_its_line_and_column() -> None:
    (said,) = mistakes_in('[rig]\nname = "x\n')
    assert said.startswith("r.toml: is not TOML:")
    assert "line 2" in said


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda path: None, "no such rig file"),
        (lambda path: path.mkdir(), "is a folder"),
        (lambda path: path.write_bytes(b"name = '\xff'"), "is not text"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_sentence(tmp_path: Path, make: Callable[[Path], object], said: str) -> None:
    path = tmp_path / "rig.toml"
    make(path)
    with pytest.raises(RigError, match=said) as refusal:
        load_rig(path)
    assert "\n" not in str(refusal.value)


def test_neighbours_of_a_missing_file_are_offered(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("")
    with pytest.raises(RigError, match=r"there are: \S+mine\.toml$"):
        load_rig(tmp_path / "mien.toml")
    (tmp_path / "session.toml").write_text('[[step]]\ndo = "tare"\n')
    (tmp_path / "rig.toml").write_text((RIGS / "sim-odrive.toml").read_text())
    with pytest.raises(RigError, match=r"there are: \S+rig\.toml$"):
        load_rig(tmp_path / "mien.toml")
    with pytest.raises(UsageError, match=r"there are: \S+session\.toml$"):
        load_session(tmp_path / "mien.toml")


@settings(deadline=None)
@given(
    torque_nm=st.floats(1e-3, 2.0),
    velocity_rad_s=st.floats(1e-3, 1e4),
    stale_ms=st.integers(4, 1000),
    rate_hz=st.integers(500, 5000),
)
def test_numbers_survive_the_file(torque_nm: float, velocity_rad_s: float, stale_ms: int, rate_hz: int) -> None:
    text = (
        GOOD.replace('torque = "1 N*m"', f'torque = "{torque_nm!r} N*m"')
        .replace('"600 rpm"', f'"{velocity_rad_s!r} rad/s"')
        .replace('"8 ms"', f'"{stale_ms} ms"')
        .replace('"500 Hz"', f'"{rate_hz} Hz"')
    )
    rig = parse_rig(text, place="r.toml")
    assert rig.limits.torque_nm == torque_nm
    assert rig.limits.velocity_rad_s == velocity_rad_s
    assert rig.limits.stale_after_ns == stale_ms * 1_000_000
    assert rig.tick_ns == pytest.approx(1e9 / rate_hz, abs=0.5)


@settings(deadline=None, max_examples=50)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=5), lambda inner: st.lists(inner, max_size=2)
    )
)
def test_any_value_anywhere_gives_sentences(value: object) -> None:
    if value is None or not str(value).isprintable() or '"' in str(value) or "\\" in str(value):
        return
    for key in ('"500 Hz"', '"bota"', '"600 rpm"', "-1", '"can0"', '{ unit = "A", limit = "12 A" }'):
        said: list[str] = []
        try:
            parse_rig(GOOD.replace(f"= {key}", f"= {toml(value)}"), place="r.toml")
        except RigError as refusal:
            said = str(refusal).splitlines()
        assert all(line.startswith("r.toml: ") for line in said)


@pytest.mark.parametrize(
    ("written", "mistake"),
    [
        ('driver = "dbc"\nbus = "can0"\ndbc = "nowhere.dbc"', '[torque_sensor] dbc = "nowhere.dbc" is neither a file'),
        ('driver = "dbc"\nbus = "can0"\nsignal = "Tork"', '[torque_sensor] signal = "Tork" is not a signal of '),
        ('driver = "canopen"\nbus = "can0"\nnode = 5\nscale = "1 mN*m"\nheartbeat = "10 ms"\neds = "no.eds"',
         '[torque_sensor] eds = "no.eds" is neither a file'),
        ('driver = "canopen"\nbus = "can0"\nnode = 5\nscale = "1 mN*m"\nheartbeat = "10 ms"\noffset = 6',
         "[torque_sensor] an i32 at offset = 6 does not fit"),
    ],
)  # fmt: skip
def test_what_only_opening_the_device_would_tell_is_told_before(written: str, mistake: str) -> None:
    text = GOOD.replace('driver = "bota"\nport = "/dev/ttyUSB0"\naxis = "z"', written)
    (sentence,) = mistakes_in(text)
    assert sentence.startswith(f"r.toml: {mistake}")


@pytest.mark.parametrize(
    ("name", "rests", "a_place"),
    [
        ("sim-odrive", False, False),  # a motor is turned
        ("sim-gravity", True, False),  # a torque against a weight
        ("sim-series-elastic", True, True),
        ("sim-pneumatic", True, True),  # each pressure has its place
        ("sim-servo", True, True),
        ("sim-mit-velocity", False, False),
    ],
)
def test_whether_a_shaft_rests_under_its_command_and_where(name: str, rests: bool, a_place: bool) -> None:
    rig = load_rig(RIGS / f"{name}.toml")
    assert (rig.may_be_a_spring, rig.command_may_be_a_place) == (rests, a_place)
