"""Long work in small steps, as a generator: between steps the caller can do something else."""

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")
Steps = Generator[None, None, T]


def run_to_completion(steps: Steps[T]) -> T:
    """Runs all steps and returns the generator's result."""
    while True:
        try:
            next(steps)
        except StopIteration as done:
            result: T = done.value
            return result
