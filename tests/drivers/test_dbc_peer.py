"""The driver of a sensor that a DBC file describes, in wall time, against a process that encodes with cantools."""

import os
import subprocess
import sys
import time

import pytest

from norton_drivers import dbc_sensor
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.link import Link
from norton_drivers.wiring import CanBusSettings, DeviceSettings

GROUP = f"239.77.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
UDP_PORT = 40_000 + os.getpid() % 2_000
pytestmark = pytest.mark.wall_time

# Every fifth sample is sent twice; the hundredth and all after it say that the sensor is not well.
_SENSOR = """
import sys, time, can, cantools
message = cantools.database.load_file(sys.argv[1]).get_message_by_name("TorqueReading")
with can.Bus(sys.argv[2], "udp_multicast", port=int(sys.argv[3])) as bus:
    for count in range(100_000):
        sample = {"Torque": -0.25 + 0.001 * (count % 100), "Counter": count % 65536, "Status": count >= 100}
        data = message.encode(sample)
        for _ in range(1 + (count % 5 == 0)):
            bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))
        time.sleep(0.002)
"""


def test_a_strange_sensor_is_heard_and_lost():
    link = Link(HardwareBackend(), (CanBusSettings("can0", "udp_multicast", GROUP, options={"port": UDP_PORT}),))
    options = {"counter": "Counter", "status": "Status"}
    settings = DeviceSettings("torque_sensor", "dbc", bus="can0", direction=-1, options=options)
    try:
        sensor = dbc_sensor.open_torque_sensor(settings, link)
        with pytest.raises(DeviceTimeoutError, match="no reading"):
            sensor.identify(timeout_s=0.1)
        arguments = [str(dbc_sensor.SHIPPED / "torque-sensor.dbc"), GROUP, str(UDP_PORT)]
        process = subprocess.Popen([sys.executable, "-c", _SENSOR, *arguments])
        try:
            readings, deadline = [], time.monotonic() + 30
            while (not readings or readings[-1].valid) and time.monotonic() < deadline:
                link.wait()
                readings += sensor.take_torque()
        finally:
            process.kill()
            process.wait()
        good = [reading.torque_nm for reading in readings if reading.valid]
        assert good == pytest.approx([0.25 - 0.001 * count for count in range(100)], abs=1e-9)
        assert sensor.repeats >= 20
        link.wait(50_000_000)
        sensor.take_torque()
        with pytest.raises(DeviceTimeoutError, match="no reading"):
            sensor.identify(timeout_s=0.1)
    finally:
        link.close()
