"""``rig new``: questions whose answers are a rig file."""
