"""Python runs this at the start of every process of the guest: none waits awake for the end of a tick.

On a computer the loop stays awake for the last part of a tick, looking at the clock and at the ports, because sleep
ends late. In User-mode Linux with its own clock sleep ends in time, and each of these system calls takes 13 us.
"""

from norton_drivers import ports

ports.BUSY_NS = ports.SPIN_NS = 0
