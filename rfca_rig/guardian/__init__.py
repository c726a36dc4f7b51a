"""Guardian process: holds the CAN bus of a drive without a watchdog, and disables the motor when commands stop coming."""
