"""Vectors and matrices as smooth functions of time, evaluated together with their exact derivatives.

`signals` has scalars; what a chain of segments needs on top of them are products of matrices, directions and the angles of a
triangle whose sides move. All follow from two rules: Leibniz for products, the chain rule for functions of one number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .checks import FloatArray
from .signals import ORDER, Signal

__all__ = ["Jet", "axis_turn"]


@dataclass(frozen=True, eq=False)
class Jet:
    """A number, vector or matrix at N instants: row k of `rows` (K + 1, N, ...) is its k-th time derivative."""

    rows: FloatArray

    @classmethod
    def of(cls, signal: Signal) -> Jet:
        """A scalar signal."""
        return cls(signal.rows)

    @classmethod
    def constant(cls, value: ArrayLike, n: int) -> Jet:
        """The same at all n instants."""
        at = np.asarray(value, dtype=np.float64)
        rows = np.zeros((ORDER + 1, n, *at.shape))
        rows[0] = at
        return cls(rows)

    @classmethod
    def vector(cls, parts: Sequence[Jet]) -> Jet:
        """A vector of scalars, or a matrix of columns."""
        least = min(len(part.rows) for part in parts)
        return cls(np.stack([part.rows[:least] for part in parts], axis=-1))

    @property
    def n(self) -> int:
        """Number of instants."""
        return int(self.rows.shape[1])

    @property
    def value(self) -> FloatArray:
        """(N, ...) without derivatives."""
        return np.asarray(self.rows[0])

    def derivative(self) -> Jet:
        """The time derivative, known to one order less."""
        return Jet(self.rows[1:])

    def __add__(self, other: Jet | float) -> Jet:
        if isinstance(other, Jet):
            least = min(len(self.rows), len(other.rows))
            return Jet(self.rows[:least] + other.rows[:least])
        rows = self.rows.copy()
        rows[0] += other
        return Jet(rows)

    def __neg__(self) -> Jet:
        return Jet(-self.rows)

    def __sub__(self, other: Jet | float) -> Jet:
        return self + (-other)

    def __mul__(self, other: Jet | float) -> Jet:
        """By a number, or by a scalar that moves."""
        if not isinstance(other, Jet):
            return Jet(self.rows * other)
        deep = (...,) + (None,) * (self.rows.ndim - other.rows.ndim)
        return _leibniz(self, other, lambda a, b: a * b[deep])

    __rmul__ = __mul__

    def __matmul__(self, other: Jet) -> Jet:
        """Matrix times matrix, or matrix times vector."""
        spec = "nij,njk->nik" if other.rows.ndim == 4 else "nij,nj->ni"
        return _leibniz(self, other, lambda a, b: np.einsum(spec, a, b))

    def transposed(self) -> Jet:
        """The transposed matrix."""
        return Jet(np.swapaxes(self.rows, -1, -2))

    def dot(self, other: Jet) -> Jet:
        """Scalar product."""
        return _leibniz(self, other, lambda a, b: np.einsum("ni,ni->n", a, b))

    def cross(self, other: Jet) -> Jet:
        """Vector product."""
        return _leibniz(self, other, np.cross)

    def unit(self) -> Jet:
        """The direction of a vector that is nowhere zero."""
        square = self.dot(self)
        x = square.value
        return self * square.through([x**-0.5, -0.5 * x**-1.5, 0.75 * x**-2.5, -1.875 * x**-3.5])

    def through(self, derivatives: Sequence[FloatArray]) -> Jet:
        """f(self) of a scalar, from f and its derivatives there: the chain rule to third order."""
        u = self.rows
        f = derivatives
        rows = [f[0]]
        if len(u) > 1:
            rows.append(f[1] * u[1])
        if len(u) > 2:
            rows.append(f[2] * u[1] ** 2 + f[1] * u[2])
        if len(u) > 3:
            rows.append(f[3] * u[1] ** 3 + 3.0 * f[2] * u[1] * u[2] + f[1] * u[3])
        return Jet(np.array(rows))

    def sin(self) -> Jet:
        """Of an angle."""
        s, c = np.sin(self.value), np.cos(self.value)
        return self.through([s, c, -s, -c])

    def cos(self) -> Jet:
        """Of an angle."""
        s, c = np.sin(self.value), np.cos(self.value)
        return self.through([c, -s, -c, s])

    def arccos(self) -> Jet:
        """Of a number strictly between -1 and 1."""
        x = self.value
        w = 1.0 - x * x
        return self.through([np.arccos(x), -(w**-0.5), -x * w**-1.5, -(1.0 + 2.0 * x * x) * w**-2.5])

    def tanh(self) -> Jet:
        """Softly limited to -1 .. 1."""
        y = np.tanh(self.value)
        slope = 1.0 - y * y
        return self.through([y, slope, -2.0 * y * slope, slope * (6.0 * y * y - 2.0)])


def _leibniz(a: Jet, b: Jet, product: Callable[[FloatArray, FloatArray], FloatArray]) -> Jet:
    order = min(len(a.rows), len(b.rows)) - 1
    return Jet(
        np.array([sum(math.comb(k, i) * product(a.rows[i], b.rows[k - i]) for i in range(k + 1)) for k in range(order + 1)])
    )


def axis_turn(axis: ArrayLike, angle: Jet) -> Jet:
    """The rotation matrix of a turn by `angle` (rad) about a fixed unit vector (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    n = angle.n
    turn = Jet.constant(across, n) * angle.sin() + Jet.constant(across @ across, n) * (-angle.cos() + 1.0)
    return turn + Jet.constant(np.eye(3), n)
