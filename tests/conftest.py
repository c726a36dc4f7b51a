"""What all tests share."""

import os
import signal
import tempfile

from hypothesis import settings

# a machine that is busy with something else is slow, which is no fault of what is tested
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

# tests that run side by side, each with threads of linear algebra that spin for the same cores, take many times as long; set before
# numpy is loaded, and for what tests start
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# the list of trusted code of whoever runs the tests stays as it is
os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="rfca-rig-tests-")

# a shell that starts tests in the background has them and their children deaf to ^C, which some are about
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
