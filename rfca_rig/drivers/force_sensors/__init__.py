"""Drivers of force sensors, each a `roles.ForceSensor`: `netft`, `ati_serial`, `daq_ft`, and `record_stream` for plug-ins.

`records` checks what they receive.
"""
