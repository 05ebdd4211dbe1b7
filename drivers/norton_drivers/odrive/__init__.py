"""ODrive drives, CANSimple protocol, firmware 0.5 and 0.6."""

from norton_drivers.odrive.drive import ODrive, ODriveOptions, open_amplifier

__all__ = ["ODrive", "ODriveOptions", "open_amplifier"]
