"""Random and damaged frames and bytes for every codec, and what must not come of them.

An exception must not, and neither must a *false reading*: one that nobody sent. Two kinds of devices are fed
differently. A frame on a CAN bus has no checksum that a program sees (the controller has checked the bus's own): one
with the right identifier and length *is* a reading, and false is only what another decoder, written here by hand or
nobody's here, reads otherwise or not at all. What comes over a serial line is damaged on the way: false is every
reading that the device did not send.
"""
