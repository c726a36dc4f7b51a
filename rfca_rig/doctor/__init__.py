"""Diagnostics of the rig: `looking` probes devices and computer, `judging` evaluates what was seen and proposes a fix."""
