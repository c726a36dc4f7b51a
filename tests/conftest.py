"""What all tests share."""

import signal

from hypothesis import settings

# a machine that is busy with something else is slow, which is no fault of what is tested
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

# a shell that starts tests in the background has them and their children deaf to ^C, which some are about
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
