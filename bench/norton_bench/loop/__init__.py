"""The tick: receive, align, control, guard, send, put away."""
