"""Arrays as they come from a caller, and as results hold them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast.errors import InputError

__all__ = ["ReadOnly", "as_array"]


def as_array(name: str, value: object) -> NDArray[np.float64]:
    """The value as C-contiguous float64; what is not numbers is refused by name."""
    try:
        return np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers, shape (3,) or (N, 3); got {type(value).__name__}") from None


class ReadOnly:
    """Base of frozen dataclasses whose arrays cannot be written to either; the caller's own stay as they are."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                view = value.view()
                view.setflags(write=False)
                object.__setattr__(self, name, view)
