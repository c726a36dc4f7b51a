"""Probes of buses, ports, devices and this computer. They send nothing that could move the shaft."""
