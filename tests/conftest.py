"""What all tests share."""

from hypothesis import settings

# a machine that is busy with something else is slow, which is no fault of what is tested
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")
