"""The mock of the package odrive-can in a process of its own, on a group and a port that are this process's own."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

NODE = 3
# python-can's bus hears every group that is joined on the machine.
GROUP = f"239.75.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"

# The mock fills in a heartbeat's signals of 0.6: those of the file in use are made of them, zero where it has none.
_SCRIPT = """
import can
from odrive_can import get_dbc
from odrive_can.mock import ODriveCANMock
mock = ODriveCANMock({node}, can.Bus({group!r}, "udp_multicast", port={port}))
mock.dbc = get_dbc("odrive-cansimple-{version}")
heartbeat = mock.dbc.get_message_by_name("Axis{node}_Heartbeat")
encode, names = heartbeat.encode, [signal.name for signal in heartbeat.signals]
heartbeat.encode = lambda values: encode(dict((name, values.get(name, 0)) for name in names))
mock.start()
"""


@contextmanager
def mock_drive(port: int, version: str) -> Iterator[subprocess.Popen[bytes]]:
    """A drive at node ``NODE`` that speaks as the DBC file of ``version`` says, on UDP port ``port``."""
    script = _SCRIPT.format(node=NODE, group=GROUP, port=port, version=version)
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()
