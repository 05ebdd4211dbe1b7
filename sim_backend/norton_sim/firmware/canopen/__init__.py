"""What CANopen devices have in common: an object dictionary, its SDO server, process data and network management."""
