"""Diagnostics of the rig. Entry points in `rig_checks`: `check_rig` for a rig file, `scan` without
one.

1. `computer` checks this computer.
2. `ports` has `look` functions, which probe without moving anything, and `judge` functions, which
   turn what was seen into findings.
3. `rig_checks` checks all devices of a rig file in turn: motor and force sensor by the checks in
   their folders (`rfca_rig.devices`), plug-in devices through their own drivers.

Each check gives a `devices.checks.Finding`: a colour, the observation, and the fix.
"""
