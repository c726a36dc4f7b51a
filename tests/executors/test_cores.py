"""Linear algebra beside threads of one's own."""

import numpy as np
import pytest
from scipy.linalg import cho_factor
from threadpoolctl import threadpool_info, threadpool_limits

from rfca_rig.executors.cores import single_threaded_blas


def threads_of_algebra() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_algebra_keeps_to_one_thread_as_long_as_it_is_told_to():
    cho_factor(np.eye(2))  # scipy brings a library of its own
    with threadpool_limits(limits=2, user_api="blas"):
        with single_threaded_blas():
            assert threads_of_algebra() == {1}
        assert threads_of_algebra() == {2}
        with pytest.raises(ZeroDivisionError), single_threaded_blas():
            raise ZeroDivisionError
        assert threads_of_algebra() == {2}
