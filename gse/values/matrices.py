"""Products and fits of matrices, with the same digits on every processor.

``@``, ``np.dot`` and ``np.linalg`` go to OpenBLAS, which adds up in another order on each kind of processor, unless an
environment variable was set before numpy was loaded: too late in a notebook, or on a worker of Dask. The last bit of a
result then decides a figure that lies half way between two printed ones. So nothing in this program uses them: here
each sum has one order, in numpy's own loops or in compiled code without fastmath. The names are those of np.linalg,
whose functions do the same; a test keeps the others out. np.linalg.norm over an axis does not go to OpenBLAS, and is
allowed.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gse.process.jit import compiled

_SUBSCRIPTS = {(1, 1): "i,i->", (1, 2): "i,...ij->...j", (2, 1): "...ij,j->...i", (2, 2): "...ij,...jk->...ik"}
"""By whether each factor is a vector (1), or a matrix or a stack of matrices (2)."""
_SWEEPS = 60
"""Convergence is quadratic: some 6 to 12 sweeps of Jacobi rotations do, the rest is a cap."""
_EPSILON = float(np.finfo(np.float64).eps)


def product(first: ArrayLike, *others: ArrayLike) -> Any:
    """Matrix product from left to right, as ``first @ second @ ...``: of vectors, matrices and stacks of matrices."""
    result = np.asarray(first)
    for other in others:
        factor = np.asarray(other)
        subscripts = _SUBSCRIPTS[min(result.ndim, 2), min(factor.ndim, 2)]
        result = np.einsum(subscripts, result, factor, order="C")
    return result


def weighted_sums(weights: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums (I, ...) over j of ``weights[j, i] * rows[j]``, of weights (J, I) and rows (J, ...): each adds up by j.

    ``product(weights.T, rows)`` to the last digit where a row has more than one number, and ten times as fast.
    """
    numbers = np.ascontiguousarray(rows.reshape(len(rows), -1))
    sums = _weighted_sums(np.ascontiguousarray(weights), numbers)
    return np.ascontiguousarray(sums.T).reshape(weights.shape[1], *rows.shape[1:])


def length(vector: ArrayLike) -> float:
    """Square root of the sum of the squares of all elements: np.linalg.norm without an axis."""
    return math.sqrt(float(np.square(vector).sum()))


def det(matrices: ArrayLike) -> Any:
    """Determinant of a matrix (3, 3), or of each in a stack."""
    rows = np.asarray(matrices, dtype=np.float64)
    return (np.cross(rows[..., 0, :], rows[..., 1, :]) * rows[..., 2, :]).sum(axis=-1)


def solve(matrices: ArrayLike, right: ArrayLike) -> NDArray[np.float64]:
    """x of ``matrix @ x = right`` for a matrix (n, n) and a right side (n,) or (n, k), or stacks (..., n, k) of them.

    LinAlgError where a matrix is singular.
    """
    left, sides = np.asarray(matrices, dtype=np.float64), np.asarray(right, dtype=np.float64)
    if sides.ndim == 1:
        return solve(left, sides[:, None])[..., 0]
    stack = np.broadcast_shapes(left.shape[:-2], sides.shape[:-2])
    rows = np.empty((*stack, left.shape[-1], left.shape[-1] + sides.shape[-1]))
    rows[..., : left.shape[-1]], rows[..., left.shape[-1] :] = left, sides
    if not _eliminate(rows.reshape(-1, *rows.shape[-2:])):
        raise np.linalg.LinAlgError("Singular matrix")
    return rows[..., left.shape[-1] :]


def inv(matrices: ArrayLike) -> NDArray[np.float64]:
    """Inverse of a matrix (n, n), or of each in a stack; LinAlgError where one is singular."""
    return solve(matrices, np.eye(np.shape(matrices)[-1]))


def cholesky(matrices: ArrayLike) -> NDArray[np.float64]:
    """Lower triangle L of ``matrix = L @ L.T``, or of each in a stack; LinAlgError where one is not positive."""
    lower = np.ascontiguousarray(np.tril(np.asarray(matrices, dtype=np.float64)))
    if not _take_root(lower.reshape(-1, *lower.shape[-2:])):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return lower


def log_det(matrix: ArrayLike) -> float:
    """Logarithm of the determinant of a positive definite matrix; LinAlgError of another one."""
    return 2 * float(np.log(np.diag(cholesky(matrix))).sum())


def eigh(matrix: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues (n,) of a symmetric matrix, from small to great, and its eigenvectors in the columns (n, n)."""
    values = _finite(matrix)
    vectors = np.eye(len(values))
    _turn_diagonal(values, vectors)
    order = np.argsort(np.diag(values), kind="stable")
    return np.diag(values)[order], vectors[:, order]


def pinv(matrix: ArrayLike, rcond: float = 1e-15) -> NDArray[np.float64]:
    """Inverse (n, m) of a matrix (m, n) without its singular values up to ``rcond`` of the greatest one."""
    columns = _finite(matrix)
    if columns.shape[0] < columns.shape[1]:
        return pinv(columns.T, rcond).T
    vectors = np.eye(columns.shape[1])
    _turn_orthogonal(columns, vectors)
    squares = np.square(columns).sum(axis=0)
    is_kept = np.sqrt(squares) > rcond * math.sqrt(float(squares.max(initial=0.0)))
    inverse: NDArray[np.float64] = product(vectors[:, is_kept] / squares[is_kept], columns[:, is_kept].T)
    return inverse


def lstsq(matrix: ArrayLike, right: ArrayLike, rcond: float | None = None) -> Any:
    """The shortest x that makes ``matrix @ x - right`` least; singular values up to ``rcond`` of the greatest are 0."""
    return product(pinv(matrix, _EPSILON * max(np.shape(matrix)) if rcond is None else rcond), right)


def straight_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Slope, and value at x = 0, of the line that fits y (n,) over x (n,) best: np.polyfit of degree 1."""
    about = x - x.mean()
    slope = float((about * y).sum()) / float(np.square(about).sum())
    return slope, float(y.mean()) - slope * float(x.mean())


def _finite(matrix: ArrayLike) -> NDArray[np.float64]:
    """A copy; LinAlgError where something in it is not finite, as LAPACK does not converge then."""
    copy = np.array(matrix, dtype=np.float64, order="C")
    if not np.isfinite(copy).all():
        raise np.linalg.LinAlgError("a matrix holds what is not finite")
    return copy


@compiled
def _weighted_sums(weights: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of weights (J, I) and rows (J, K), as (K, I): along I the processor adds several at once."""
    sums = np.zeros((rows.shape[1], weights.shape[1]))
    for j in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            number = rows[j, k]
            for i in range(weights.shape[1]):
                sums[k, i] += weights[j, i] * number
    return sums


@compiled
def _eliminate(rows: NDArray[np.float64]) -> bool:
    """Gauss-Jordan with the greatest pivot of a column, in place, of (K, n, n + k); False where one is singular."""
    size = rows.shape[1]
    for one in rows:
        for j in range(size):
            best = j
            for i in range(j + 1, size):
                if abs(one[i, j]) > abs(one[best, j]):
                    best = i
            if one[best, j] == 0.0:
                return False
            for k in range(j, one.shape[1]):
                one[j, k], one[best, k] = one[best, k], one[j, k]
            for i in range(size):
                factor = one[i, j] / one[j, j]
                if i != j and factor != 0.0:
                    for k in range(j, one.shape[1]):
                        one[i, k] -= factor * one[j, k]
        for i in range(size):
            pivot = one[i, i]
            for k in range(size, one.shape[1]):
                one[i, k] /= pivot
    return True


@compiled
def _take_root(lower: NDArray[np.float64]) -> bool:
    """Cholesky's factors of lower triangles (K, n, n), in place; False where a matrix is not positive."""
    for one in lower:
        for j in range(one.shape[0]):
            for k in range(j):
                one[j, j] -= one[j, k] * one[j, k]
            if not one[j, j] > 0.0:
                return False
            one[j, j] = math.sqrt(one[j, j])
            for i in range(j + 1, one.shape[0]):
                for k in range(j):
                    one[i, j] -= one[i, k] * one[j, k]
                one[i, j] /= one[j, j]
    return True


@compiled
def _turn_diagonal(matrix: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Jacobi rotations that leave a symmetric matrix (n, n) diagonal, in place, and turn ``vectors`` (n, n) alike.

    Golub & Van Loan, section 8.5.
    """
    size = matrix.shape[0]
    for _ in range(_SWEEPS):
        is_done = True
        for p in range(size - 1):
            for q in range(p + 1, size):
                if abs(matrix[p, q]) <= 1e-17 * math.sqrt(abs(matrix[p, p] * matrix[q, q])) or matrix[p, q] == 0.0:
                    continue
                is_done = False
                theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                t = math.copysign(1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0)), theta)
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(size):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
                for k in range(size):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b
                matrix[p, q] = matrix[q, p] = 0.0
        if is_done:
            return


@compiled
def _turn_orthogonal(columns: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Jacobi rotations that leave the columns (m, n) orthogonal, in place, and turn ``vectors`` (n, n) alike.

    The one-sided way to singular values (Golub & Van Loan, section 8.6): the lengths of the columns.
    """
    count = columns.shape[1]
    for _ in range(_SWEEPS):
        is_done = True
        for p in range(count - 1):
            for q in range(p + 1, count):
                pp, qq, pq = 0.0, 0.0, 0.0
                for k in range(columns.shape[0]):
                    pp += columns[k, p] * columns[k, p]
                    qq += columns[k, q] * columns[k, q]
                    pq += columns[k, p] * columns[k, q]
                if abs(pq) <= 1e-15 * math.sqrt(pp * qq):
                    continue
                is_done = False
                theta = (qq - pp) / (2.0 * pq)
                t = math.copysign(1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0)), theta)
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(columns.shape[0]):
                    a, b = columns[k, p], columns[k, q]
                    columns[k, p], columns[k, q] = c * a - s * b, s * a + c * b
                for k in range(count):
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b
        if is_done:
            return
