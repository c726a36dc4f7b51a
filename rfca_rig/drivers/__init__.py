"""Device drivers behind the protocols in `roles`; `bench` opens them.

1. `ports` and `can_frames` are the wires; `guard` is the interface to a process that disables the motor when commands stop.
2. `device_time` stamps what arrives.
3. `speed_drive` is the base class of plug-in motor drivers, on the time-stamped reports of `drive_report`.
4. `force_sensors` and `camera` are drivers; `photo_files` reads photos from files. The drivers of motors are in `devices`.
"""
