"""Device drivers behind the protocols in `roles`; `bench` opens them.

1. `ports` and `can_frames` are the wires; `guard` is the interface to a process that disables the
   motor when commands stop.
2. `device_time` stamps what arrives.
3. `motor_drive` and `record_stream` are base classes of drivers of motors and force sensors;
   `speed_drive` is that of plug-in motor drivers. `drive_report` receives the reports of a drive.
   The counters of `record_stream` are those of every force sensor.
4. `camera` is a driver; `photo_files` reads photos from files. The drivers of motors and force
   sensors are in `devices`.
"""
