# SPDX-License-Identifier: MIT
"""Checks of functions of the user before they are called."""

import inspect

from .errors import ContactInputError
from .validators import kind, shown


def check_callable(function: object, what: str, *arguments: str) -> None:
    """Raise a ContactInputError unless something can be called with these arguments.

    Args:
        function: The function.
        what: Its name in the message.
        arguments: Names of its arguments in the message.
    """
    call = f"{what}({', '.join(arguments)})"
    if not callable(function):
        raise ContactInputError(
            f"{what} = {shown(function)} is {kind(function)}; give a function, called as {call}."
        )
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some built-in functions have none
        return
    try:
        signature.bind(*arguments)
    except TypeError as error:
        raise ContactInputError(
            f"{what} = {shown(function)} cannot be called as {call}: {error}."
        ) from error
