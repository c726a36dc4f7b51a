"""Holds the CAN bus of a drive that has no watchdog, and takes its torque away where commands stop coming."""
