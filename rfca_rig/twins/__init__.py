"""Device twins: simulated drives, sensors and cameras that exchange the same bytes as the real devices."""
