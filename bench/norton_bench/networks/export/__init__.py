"""Networks for use elsewhere: C, the functional mock-up interface, MuJoCo (docs/networks.md)."""
