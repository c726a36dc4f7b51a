"""A helper process for tests: answers one message, then stays."""

import sys
from multiprocessing.connection import Connection

if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        parent.recv()
        parent.send("something")
        parent.recv()
