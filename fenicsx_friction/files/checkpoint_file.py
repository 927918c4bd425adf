# SPDX-License-Identifier: MIT
"""Content of a checkpoint to and from its file; rank 0 only.

All content of a file is checked before any of it is used.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.errors import CheckpointError
from .checkpoint_content import Content, Expected
from .sealed_file import reading, writing

Array = npt.NDArray[Any]
#: Kinds of real numbers, as ``numpy.dtype.kind``.
REAL, INTEGER = "fiu", "iu"
#: Group of the arrays.
VALUES = "values/"


@dataclass(frozen=True)
class Stored:
    """What a file holds.

    Attributes:
        num_steps: Number of accepted steps.
        dt: Length of the last one.
        scalars: The user's numbers.
        motions: Positions of the moving obstacles, each as ``RigidMotion.save()`` returns it.
        arrays: The values by name.
    """

    num_steps: int
    dt: float
    scalars: dict[str, float]
    motions: list[list[Array]]
    arrays: dict[str, Array]


def store(path: str | os.PathLike[str], content: Content, stored: Stored) -> None:
    """Write a file that can be read, or leave the old one.

    Raises:
        CheckpointError: If a value is not finite.
        OSError: If the file cannot be written.
    """
    expected = content.expected(stored.arrays)
    for name, values in stored.arrays.items():
        expected[name].check(name, values.shape, values.dtype)
        _check_finite(name, values)
    _check_finite("dt", stored.dt)
    with writing(Path(path)) as h5:
        h5.attrs.update(_provenance())
        h5.create_group("problem").attrs.update(content.description)
        h5.create_group("numbers").attrs.update({"num_steps": stored.num_steps, "dt": stored.dt})
        h5.create_group("scalars").attrs.update(stored.scalars)
        h5["mesh"] = content.nodes
        for k, motion in enumerate(stored.motions):
            position = np.hstack([v.ravel() for v in motion])
            _check_finite(f"motions/{k}", position)
            h5[f"motions/{k}"] = position
        for name, values in stored.arrays.items():
            h5[VALUES + name] = values


def load(path: str | os.PathLike[str], content: Content) -> Stored:
    """Read a file after checking that it is intact and fits to the problem.

    Raises:
        CheckpointError: If it is damaged or does not fit.
        OSError: If it cannot be read.
    """
    with reading(Path(path)) as h5:
        found: dict[str, Any] = {}
        h5.visititems(found.__setitem__)  # follows no external link
        content.compare(_attributes(found, "problem"))
        nodes = content.nodes
        content.compare_nodes(_array(found, "mesh", Expected(len(nodes), nodes.shape[1:], "f")))
        numbers, scalars = (_attributes(found, name) for name in ("numbers", "scalars"))
        return Stored(
            num_steps=_number(numbers, "num_steps", INTEGER),
            dt=float(_number(numbers, "dt", REAL)),
            scalars={name: float(_number(scalars, name, REAL)) for name in scalars},
            motions=[
                _position(found, f"motions/{k}", motion.save())
                for k, motion in enumerate(content.motions)
            ],
            arrays={
                name: _array(found, VALUES + name, expected)
                for name, expected in content.expected(_value_names(found)).items()
            },
        )


def checked_scalars(scalars: Mapping[str, float]) -> dict[str, float]:
    """Return the user's scalars as floats, or raise a CheckpointError."""
    wanted = "scalars must be a dictionary of finite real numbers"
    if not isinstance(scalars, Mapping):
        raise CheckpointError(f"{wanted}, not {scalars!r}.")
    checked = {}
    for name, value in scalars.items():
        try:
            checked[str(name)] = float(value)
        except (TypeError, ValueError) as error:
            raise CheckpointError(f"{wanted}: '{name}': {error}.") from error
        if not np.isfinite(checked[str(name)]):
            raise CheckpointError(f"{wanted}: '{name}' is {value}.")
    return checked


def _attributes(found: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the attributes of a group."""
    if name not in found:
        raise CheckpointError(f"is damaged: it does not hold '{name}'.")
    return dict(found[name].attrs)


def _number(attributes: Mapping[str, Any], name: str, kinds: str) -> Any:
    """Return a finite number."""
    value = np.asarray(attributes.get(name))
    if value.shape != () or value.dtype.kind not in kinds or not np.isfinite(value):
        raise CheckpointError(f"holds no number '{name}' that can be used: {value}.")
    if kinds == INTEGER and value < 0:
        raise CheckpointError(f"holds a negative number '{name}': {value}.")
    return value.item()


def _value_names(found: Mapping[str, Any]) -> list[str]:
    """Return the names of the arrays, without those of the groups they are in."""
    names = [name for name in found if name.startswith(VALUES)]
    return [n.removeprefix(VALUES) for n in names if not any(m.startswith(n + "/") for m in names)]


def _array(found: Mapping[str, Any], name: str, expected: Expected) -> Array:
    """Return an array of the shape and type expected, and of finite numbers."""
    entry: Any = found.get(name)
    if not hasattr(entry, "shape"):
        raise CheckpointError(f"is damaged: it does not hold '{name}'.")
    expected.check(name, entry.shape or (), entry.dtype)
    if entry.is_virtual or entry.external:
        raise CheckpointError(f"is damaged: '{name}' is in another file.")
    values = np.asarray(entry[...], dtype=entry.dtype.newbyteorder("="))
    _check_finite(name, values)
    return values


def _position(found: Mapping[str, Any], name: str, saved: Sequence[Array]) -> list[Array]:
    """Return the position of a motion in the shapes of a saved one."""
    values = _array(found, name, Expected(sum(v.size for v in saved), (), "f"))
    pieces = np.split(values, np.cumsum([v.size for v in saved])[:-1])
    return [piece.reshape(old.shape) for piece, old in zip(pieces, saved, strict=True)]


def _check_finite(name: str, values: Array | float) -> None:
    """Raise unless all numbers are finite."""
    if not np.all(np.isfinite(values)):
        raise CheckpointError(f"'{name}' holds numbers that are not finite.")


def _provenance() -> dict[str, str]:
    """Return the versions that write a file."""
    import dolfinx

    from .. import __version__

    return {"fenicsx_friction": __version__, "dolfinx": dolfinx.__version__}
