"""The bench moved by hand: nudge a torque or a velocity, watch every signal, stop."""
