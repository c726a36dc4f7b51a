"""Diagnostics of the rig. Entry points: `rig_checks.check_rig` for a rig file, `scan.scan` without one.

1. `computer` checks this computer.
2. `devices` has one module per kind of device: it probes, without moving anything, and evaluates what was seen, by pure functions.
3. `rig_checks` checks all devices of a rig file in turn, plug-in devices through their own drivers.

Each check gives a `finding`: a colour, the observation, and the fix.
"""
