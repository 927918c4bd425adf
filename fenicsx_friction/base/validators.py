# SPDX-License-Identifier: MIT
"""Checks of single arguments, which name argument, value and cure."""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import ufl
from ufl.core.expr import Expr

from .errors import ContactInputError

T = TypeVar("T")
#: What counts as a real number: integers and floats of Python and NumPy, no bool.
REAL = "iuf"


def number(
    value: object,
    what: str,
    *,
    at_least: float = -np.inf,
    above: float = -np.inf,
    below: float = np.inf,
) -> float:
    """Return a real number in a range, or raise.

    Args:
        value: The argument.
        what: Its name in the message.
        at_least: Least value allowed.
        above: Bound that the value must exceed.
        below: Bound that the value must not reach; infinite values are always refused.
    """
    array = np.asarray(value) if isinstance(value, int | float | np.ndarray | np.generic) else None
    bounds = [
        f">= {at_least:g}" if at_least > -np.inf else "",
        f"> {above:g}" if above > -np.inf else "",
        f"< {below:g}" if below < np.inf else "",
    ]
    wanted = " and ".join([*filter(None, bounds), "finite"])
    if array is None or array.ndim != 0 or array.dtype.kind not in REAL:
        raise ContactInputError(
            f"{what} = {shown(value)} must be a number, {wanted}, not {kind(value)}."
        )
    result = float(array)
    if not (np.isfinite(result) and at_least <= result and above < result < below):
        raise ContactInputError(f"{what} = {shown(value)} must be {wanted}.")
    return result


def integer(value: object, what: str, *, at_least: int | None = None) -> int:
    """Return an integer, or raise."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise ContactInputError(f"{what} = {shown(value)} must be an integer, not {kind(value)}.")
    if at_least is not None and value < at_least:
        raise ContactInputError(f"{what} = {shown(value)} must be >= {at_least}.")
    return int(value)


def vector(value: object, what: str, *, dimension: int | None = None) -> npt.NDArray[np.float64]:
    """Return finite components, or raise.

    Args:
        value: A sequence of real numbers.
        what: Its name in the message.
        dimension: How many there must be; by default two or three.
    """
    count = "2 or 3" if dimension is None else str(dimension)
    wanted = f"must be a sequence of {count} finite numbers"
    try:
        array = np.asarray(value) if isinstance(value, list | tuple | np.ndarray) else None
    except ValueError:  # rows of different length
        array = None
    if array is None or array.ndim != 1 or array.dtype.kind not in REAL:
        raise ContactInputError(f"{what} = {shown(value)} {wanted}, not {kind(value)}.")
    if len(array) not in ((2, 3) if dimension is None else (dimension,)):
        raise ContactInputError(f"{what} = {shown(value)} {wanted}; it has {len(array)}.")
    if not np.all(np.isfinite(array)):
        raise ContactInputError(f"{what} = {shown(value)} {wanted}.")
    return array.astype(np.float64)


def instance(value: Any, types: type, what: str, cure: str) -> Any:
    """Return the value if it is of a type, or raise.

    Args:
        value: The argument.
        types: Its type.
        what: Its name in the message.
        cure: An example of what may be given.
    """
    if not isinstance(value, types):
        raise ContactInputError(f"{what} = {shown(value)} is {kind(value)}; give {cure}.")
    return value


def instances(value: Any, one: type[T], what: str, cure: str) -> list[T]:
    """Return one object of a type, or a sequence of such, as a list, or raise."""
    if isinstance(value, one):
        return [value]
    if not isinstance(value, list | tuple):
        raise ContactInputError(
            f"{what} = {shown(value)} is {kind(value)}; give {cure}, or a list of such."
        )
    return [instance(item, one, f"{what}[{i}]", cure) for i, item in enumerate(value)]


def choice(value: object, what: str, allowed: Iterable[object]) -> None:
    """Raise unless the value, a string or an integer, is one of those allowed."""
    allowed = tuple(allowed)
    plain = isinstance(value, str | int | np.integer) and not isinstance(value, bool)
    if not plain or value not in allowed:
        raise ContactInputError(f"{what} = {shown(value)} must be one of {allowed}.")


def text(value: object, what: str) -> str:
    """Return a string that is not empty, or raise."""
    if not isinstance(value, str) or not value.strip():
        raise ContactInputError(f"{what} = {shown(value)} must be a string that is not empty.")
    return value


def flag(value: object, what: str) -> bool:
    """Return a truth value, or raise."""
    if not isinstance(value, bool | np.bool_):
        raise ContactInputError(f"{what} = {shown(value)} must be True or False.")
    return bool(value)


def call(
    function: Callable[..., object], what: str, *arguments: object, shape: tuple[int, ...] = ()
) -> Expr:
    """Call a user's function that returns UFL.

    Args:
        function: The function.
        what: Its name and arguments in messages, ``mu(pressure, sliding)`` say.
        arguments: What it gets.
        shape: Shape that its value must have.

    Raises:
        ContactInputError: If it cannot be called so, raises, or returns something else.
    """
    wanted = f"a UFL {'scalar' if shape == () else f'expression of shape {shape}'}"
    try:
        value = function(*arguments)
    except ContactInputError:
        raise
    except Exception as error:
        raise ContactInputError(
            f"{what} raised {type(error).__name__}: {str(error).rstrip('.')}. It is called "
            f"with these arguments, UFL expressions, and must return {wanted}."
        ) from error
    try:
        expression = ufl.as_ufl(value)
    except Exception as error:
        raise ContactInputError(
            f"{what} returned {shown(value)}, {kind(value)}; it must return {wanted}."
        ) from error
    if expression.ufl_shape != shape:
        raise ContactInputError(
            f"{what} returned an expression of shape {expression.ufl_shape}; it must return "
            f"{wanted}."
        )
    return expression


def shown(value: object) -> str:
    """Return a short form of a value for messages."""
    result = str(value) if isinstance(value, np.generic) else repr(value)
    return result if len(result) <= 80 else f"{result[:77]}..."


def kind(value: object) -> str:
    """Return what a value is, for messages."""
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__} itself"
    return f"of type {type(value).__name__}"
