"""Python runs this in every process of the guest: no process waits awake, which makes the guest's clock pass no faster.

On a computer the last part of a tick is spent awake, looking at the clock and at the ports, because sleep ends late. In
User-mode Linux it ends in time, and each look is a system call that takes as long as hundreds do elsewhere.
"""

from norton_drivers import ports

ports.BUSY_NS = ports.SPIN_NS = 0
