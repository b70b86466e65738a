"""Davenport's q method: the rotation that best takes stars to directions, compiled.

The quaternion that minimises sum |b_i - A r_i|^2 / sigma_i^2 is the eigenvector of the greatest eigenvalue of a
symmetric 4 x 4 matrix. Its eigenvectors come from Jacobi rotations and not from the characteristic polynomial of QUEST,
because these stay exact for turns of 180 deg and for stars close to each other.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled_part

_MIN_SEPARATION_RAD = 1e-7
"""Directions closer than this (0.02 arcsec) to one line do not fix the roll."""
_JACOBI_SWEEPS = 20
"""Convergence is quadratic: 4 or 5 sweeps do, the rest is a cap."""


@compiled_part
def davenport(
    measured: NDArray[np.float64],
    stars: NDArray[np.float64],
    weights: NDArray[np.float64],
    rotation: NDArray[np.float64],
) -> bool:
    """Put the rotation (3, 3) that best takes ``stars`` (N, 3) to ``measured`` (N, 3) into ``rotation``.

    False, and nothing put, where something is not finite.
    """
    # The attitude profile matrix B = sum w_i b_i r_i^T: all that Wahba's problem needs of the stars is in these nine
    # sums.
    b = np.zeros((3, 3))
    total = 0.0
    for i in range(len(measured)):
        total += weights[i]
        for j in range(3):
            for k in range(3):
                b[j, k] += weights[i] * measured[i, j] * stars[i, k]
    if not (total > 0.0 and total < np.inf):
        return False
    # Davenport's K: a quadratic form in the quaternion whose value is the gain to maximise. Divided by the sum of
    # weights its greatest eigenvalue is near 1, whatever the weights, so that one threshold serves for convergence.
    #
    #     K = [ B + B^T - 1 tr B    z    ]      z = (B12 - B21, B20 - B02, B01 - B10)
    #         [        z^T         tr B  ]
    k4 = np.empty((4, 4))
    trace = (b[0, 0] + b[1, 1] + b[2, 2]) / total
    for j in range(3):
        for k in range(3):
            k4[j, k] = (b[j, k] + b[k, j]) / total
        k4[j, j] -= trace
    k4[3, 3] = trace
    k4[0, 3] = (b[1, 2] - b[2, 1]) / total
    k4[1, 3] = (b[2, 0] - b[0, 2]) / total
    k4[2, 3] = (b[0, 1] - b[1, 0]) / total
    for j in range(3):
        k4[3, j] = k4[j, 3]
    for j in range(4):
        for k in range(4):
            if not np.isfinite(k4[j, k]):
                return False
    # The best quaternion is the eigenvector of the greatest eigenvalue, which stands on the diagonal after Jacobi's
    # turns.
    vectors = np.eye(4)
    _jacobi(k4, vectors)
    best = 0
    for j in range(1, 4):
        if k4[j, j] > k4[best, best]:
            best = j
    _rotation_of(vectors[:, best], rotation)
    return True


@compiled_part
def _jacobi(matrix: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Turn a symmetric matrix (4, 4) diagonal in place; the columns of ``vectors`` become its eigenvectors."""
    for _ in range(_JACOBI_SWEEPS):
        off = 0.0
        for p in range(3):
            for q in range(p + 1, 4):
                off += matrix[p, q] ** 2
        if off < 1e-34:
            return
        for p in range(3):
            for q in range(p + 1, 4):
                if matrix[p, q] != 0.0:
                    _jacobi_rotation(matrix, vectors, p, q)


@compiled_part
def _jacobi_rotation(matrix: NDArray[np.float64], vectors: NDArray[np.float64], p: int, q: int) -> None:
    """One rotation in the plane of p and q that makes matrix[p, q] zero (Golub & Van Loan, section 8.5)."""
    # Of the two angles that make the element zero the smaller one is taken: it disturbs what is diagonal already least.
    theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(4):
        a, b = matrix[k, p], matrix[k, q]
        matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
    for k in range(4):
        a, b = matrix[p, k], matrix[q, k]
        matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
        a, b = vectors[k, p], vectors[k, q]
        vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b


@compiled_part
def _rotation_of(quaternion: NDArray[np.float64], rotation: NDArray[np.float64]) -> None:
    """The rotation (3, 3) of a unit quaternion (4,), scalar last, that turns axes (not vectors)."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    rotation[0, 0] = w * w + x * x - y * y - z * z
    rotation[1, 1] = w * w - x * x + y * y - z * z
    rotation[2, 2] = w * w - x * x - y * y + z * z
    rotation[0, 1] = 2.0 * (x * y + w * z)
    rotation[1, 0] = 2.0 * (x * y - w * z)
    rotation[0, 2] = 2.0 * (x * z - w * y)
    rotation[2, 0] = 2.0 * (x * z + w * y)
    rotation[1, 2] = 2.0 * (y * z + w * x)
    rotation[2, 1] = 2.0 * (y * z - w * x)


@compiled_part
def attitude_covariance(
    measured: NDArray[np.float64], weights: NDArray[np.float64], covariance: NDArray[np.float64]
) -> bool:
    """Put the covariance (3, 3) of the rotation vector in the sensor frame into ``covariance``.

    The inverse of the Fisher information sum w_i (1 - b_i b_i^T), which Wahba's solution reaches. False where the
    directions (N, 3) lie on one line, and then one angle is not known at all.
    """
    # A star tells nothing of a turn about itself: hence 1 - b b^T, the plane across it. Stars of a small field all
    # leave nearly the same turn open, the roll, which is why roll is 1 / (width of the field) times worse than the
    # others.
    f = np.zeros((3, 3))
    total = 0.0
    for i in range(len(measured)):
        total += weights[i]
        for j in range(3):
            for k in range(3):
                f[j, k] -= weights[i] * measured[i, j] * measured[i, k]
    for j in range(3):
        f[j, j] += total
    for j in range(3):
        # Inverse by cofactors: indices that go round give each cofactor its sign.
        j1, j2 = (j + 1) % 3, (j + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            covariance[k, j] = f[j1, k1] * f[j2, k2] - f[j1, k2] * f[j2, k1]
    determinant = f[0, 0] * covariance[0, 0] + f[0, 1] * covariance[1, 0] + f[0, 2] * covariance[2, 0]
    if not determinant > _MIN_SEPARATION_RAD**2 * total**3:
        return False
    for j in range(3):
        for k in range(3):
            covariance[j, k] /= determinant
    return True
