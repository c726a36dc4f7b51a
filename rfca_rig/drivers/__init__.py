"""Device drivers behind the protocols in `roles`; `bench` opens them.

1. `ports` and `can_frames` are the wires; `guard` is the interface to a process that disables the motor when commands stop.
2. `device_time` stamps what arrives.
3. `motors`, `force_sensors` and `camera` are the drivers; `photo_files` reads photos from files.
"""
