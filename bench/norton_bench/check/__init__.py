"""``rig check``: which devices are there, how each is doing, and what is wrong, in a sentence with the remedy."""
