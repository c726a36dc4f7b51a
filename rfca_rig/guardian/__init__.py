"""Guardian process: holds the CAN bus of a drive without a watchdog, and disables the motor when
commands stop coming.

Entry point: `guarded_bus.take_over_bus`, which starts `process`. `link` connects the two.
`process.TorqueOffSequence` is what it sends in the end.
"""
