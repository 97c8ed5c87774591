"""One set of formulas for one instant and for many: the elementary functions of floats and of arrays."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

# float for one instant, NDArray[float64] for an array of instants. An explicit Any, because a union would
# make every caller narrow it although the shape is always that of the instants given.
Quantity: TypeAlias = Any


class Functions(NamedTuple):
    """The functions that a formula needs, for floats or for arrays."""

    sin: Any
    cos: Any
    tan: Any
    sqrt: Any
    exp: Any
    atan2: Any
    where: Any


def _scalar_where(condition: bool, yes: float, no: float) -> float:
    return yes if condition else no


FLOATS = Functions(math.sin, math.cos, math.tan, math.sqrt, math.exp, math.atan2, _scalar_where)
ARRAYS = Functions(np.sin, np.cos, np.tan, np.sqrt, np.exp, np.arctan2, np.where)


def functions_for(value: Quantity) -> Functions:
    """Return the functions that fit a value: those of arrays for an array, else those of floats."""
    return ARRAYS if isinstance(value, np.ndarray) else FLOATS
