"""Looks at buses, ports, devices and this computer; sends nothing that could move a shaft."""
