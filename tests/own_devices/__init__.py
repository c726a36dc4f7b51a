"""Motors, force sensors and effects of a lab's own: the worked examples, and what a rig file may
say of them.
"""
