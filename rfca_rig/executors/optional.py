"""Optional import of dask.distributed, loaded only if a cluster is used."""

import importlib
import logging
from functools import cache
from typing import Any

from rfca_rig.errors import BadInput


@cache
def import_distributed() -> Any:
    """The package `distributed`. Raises BadInput if it is not installed.

    Its log messages on lost workers and late heartbeats are suppressed, as the executor reports them itself.
    """
    try:
        package = importlib.import_module("distributed")
    except ImportError:
        raise BadInput('--cluster needs dask.distributed: pip install "rfca-rig[cluster]"') from None
    for name in ("distributed", "distributed.client", "distributed.scheduler", "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return package
