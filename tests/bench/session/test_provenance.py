"""What a recording says of the devices that it was made with."""

from pathlib import Path

from norton_bench.rig.load import load_rig
from norton_bench.session.provenance import provenance
from norton_bench.session.schema import standard_session
from norton_drivers.readings import DeviceIdentity

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")


def test_versions_of_devices_are_named() -> None:
    devices = (DeviceIdentity("odrive", "can0 node 1", "4.4.58", "0.6.10"), DeviceIdentity("bota", "/dev/ttyUSB0"))
    told = provenance(RIG, standard_session(RIG), None, devices)["devices"]
    assert told == "odrive, can0 node 1, hardware 4.4.58, firmware 0.6.10; bota, /dev/ttyUSB0"
