"""Actuators that are more than a motor: what drives them, what joins that to the port, and the port's own body."""
