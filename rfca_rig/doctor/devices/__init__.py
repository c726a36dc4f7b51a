"""Each kind of device, bus and port: `look` functions probe it and move nothing, `judge` functions turn what was seen into findings."""
