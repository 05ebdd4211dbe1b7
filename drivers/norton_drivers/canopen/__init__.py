"""CANopen devices: one master for each bus, and the drivers of drives (CiA 402) and torque sensors on it."""
