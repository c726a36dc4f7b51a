"""Puts a rig together: devices from a rig file, the model behind the twins, the recording of what the engine runs."""
