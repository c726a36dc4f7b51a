"""Device twins: simulated drives, sensors and cameras that exchange the same bytes as the real
devices. Entry point: `world.TwinWorld`.

Twins of devices stand on `wires`. `drive_parts` has what drives share, `image_noise` what a camera
adds. `plugins` has base classes for plug-ins. The twins of motors and force sensors are in
`devices`.
"""
