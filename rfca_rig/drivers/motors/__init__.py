"""Drivers of shaft motors, each a `roles.ShaftMotor`: `cubemars_mit`, `cubemars_servo`, `moteus`, `odrive`, and `speed_drive` for plug-ins.

Each has a module that reads its reports, in device time. `drive_report.ShaftGear` converts the drive's turns to angles of the shaft.
"""
