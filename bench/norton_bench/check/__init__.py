"""``rig check``: who is there, how each fares, and what is wrong, in a sentence with the mend."""
