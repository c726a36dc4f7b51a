"""Device drivers: motors, force sensors and cameras behind the protocols in `roles`."""
