"""Arms of more than one joint: a bench for each joint, run together."""
