"""Motors that speak only when they are spoken to, in integers scaled to a range: MIT mode, Damiao, RobStride."""
