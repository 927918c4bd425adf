# SPDX-License-Identifier: MIT
"""What follows the displacement: at each call, or once for all where nothing moves."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager


class Follower(ABC):
    """Values that depend on the displacement."""

    _still = False

    def update(self) -> None:
        """Follow the displacement, as far as it has changed; collective."""
        if not self._still:
            self._follow()

    @contextmanager
    def still(self) -> Iterator[None]:
        """Follow the displacement now, and not inside, where nothing may move; collective."""
        self.update()
        before, self._still = self._still, True
        try:
            yield
        finally:
            self._still = before

    @abstractmethod
    def _follow(self) -> None:
        """Follow the displacement, as far as it has changed; collective."""


@contextmanager
def all_still(followers: Iterable[Follower]) -> Iterator[None]:
    """Hold several of them still; collective."""
    with ExitStack() as stack:
        for follower in followers:
            stack.enter_context(follower.still())
        yield
