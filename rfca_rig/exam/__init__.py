"""A blind exam of the diagnosis: cases with concealed physics, made by a simulator of its own, and their scoring."""
