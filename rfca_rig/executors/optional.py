"""dask.distributed, which is an extra: loaded where a cluster is asked for, and told of in a line where it is not installed."""

import importlib
import logging
from functools import cache
from typing import Any

from rfca_rig.errors import BadInput


@cache
def distributed() -> Any:
    """The package. Raises BadInput where it is not there.

    What it logs of lost workers and late heartbeats is told in the words of the work instead.
    """
    try:
        package = importlib.import_module("distributed")
    except ImportError:
        raise BadInput('--cluster needs dask.distributed: pip install "rfca-rig[cluster]"') from None
    for name in ("distributed", "distributed.client", "distributed.scheduler", "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return package
