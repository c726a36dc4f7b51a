"""The rig seen in a browser: a run while it goes on, from a process of its own, and any recording afterwards."""
