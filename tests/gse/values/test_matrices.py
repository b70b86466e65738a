"""Products and fits against np.linalg, and that the program takes them from nowhere else."""

import ast
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gse.values import matrices

GSE = Path(matrices.__file__).parent
ALLOWED = {
    "inspection/selfcheck.py": "an authority beside the station's own arithmetic, compared with it within a tolerance",
    "diagnosis/field_content.py": "a sparse matrix, whose product scipy adds up in loops of its own",
}
OF_BLAS = {"dot", "vdot", "inner", "matmul", "tensordot", "cov", "corrcoef", "polyfit", "correlate", "convolve"}

SIZES = st.integers(1, 12)
SEEDS = st.integers(0, 999)


@given(SIZES, SEEDS)
def test_equations_are_solved_as_by_lapack(size: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    stack, right = random.normal(size=(4, size, size)) + 3 * np.eye(size), random.normal(size=(size, 2))
    assert_allclose(matrices.solve(stack, right), np.linalg.solve(stack, right), rtol=1e-6, atol=1e-8)
    assert_allclose(matrices.inv(stack[0].T), np.linalg.inv(stack[0].T), rtol=1e-6, atol=1e-8)
    assert_allclose(matrices.solve(stack[0], right[:, 0]), np.linalg.solve(stack[0], right[:, 0]), rtol=1e-6, atol=1e-8)


@given(SIZES, SEEDS)
def test_weighted_sums_are_products_to_the_last_digit(size: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    weights, rows = random.normal(size=(7, size)), random.normal(size=(7, size + 1))
    assert np.array_equal(matrices.weighted_sums(weights, rows), matrices.product(weights.T, rows))
    assert matrices.weighted_sums(weights, rows.reshape(7, 1, -1)).shape == (size, 1, size + 1)


@given(SIZES, SEEDS)
def test_symmetric_matrices_are_taken_apart_as_by_lapack(size: int, seed: int) -> None:
    rows = np.random.default_rng(seed).normal(size=(3, size + 2, size))
    positive = rows.transpose(0, 2, 1) @ rows + np.eye(size)
    assert_allclose(matrices.cholesky(positive), np.linalg.cholesky(positive), rtol=1e-9, atol=1e-12)
    assert matrices.log_det(positive[0]) == pytest.approx(np.linalg.slogdet(positive[0])[1], abs=1e-9)
    symmetric = positive[0] - 3 * np.eye(size)
    values, vectors = matrices.eigh(symmetric)
    assert_allclose(values, np.linalg.eigh(symmetric)[0], rtol=1e-9, atol=1e-12)
    assert_allclose(symmetric @ vectors, vectors * values, rtol=0, atol=1e-10)
    assert_allclose(vectors.T @ vectors, np.eye(size), rtol=0, atol=1e-12)


@given(SIZES, SIZES, SIZES, SEEDS)
def test_what_has_no_inverse_is_fitted_as_by_lapack(rows: int, columns: int, rank: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(rows, rank)) @ random.normal(size=(rank, columns))
    right = random.normal(size=rows)
    scale = np.linalg.norm(np.linalg.pinv(matrix, 1e-10))
    assert_allclose(matrices.pinv(matrix, 1e-10), np.linalg.pinv(matrix, 1e-10), rtol=0, atol=1e-8 * scale)
    expected = np.linalg.lstsq(matrix, right, rcond=1e-10)[0]
    assert_allclose(matrices.lstsq(matrix, right, 1e-10), expected, rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize(
    ("first", "second"), [((3,), (3,)), ((3,), (3, 2)), ((2, 3), (3,)), ((4, 2, 3), (3, 5)), ((3,), (4, 3, 2))], ids=str
)
def test_a_product_has_the_shape_and_the_numbers_of_numpys(first: tuple[int, ...], second: tuple[int, ...]) -> None:
    one, other = (np.random.default_rng(7).normal(size=shape) for shape in (first, second))
    assert_allclose(matrices.product(one, other), one @ other, rtol=1e-12, atol=1e-12)
    assert np.shape(matrices.product(one, other)) == np.shape(one @ other)


def test_determinant_length_and_line_are_numpys() -> None:
    random = np.random.default_rng(8)
    stack, x, y = random.normal(size=(5, 3, 3)), random.normal(size=9), random.normal(size=9)
    assert_allclose(matrices.det(stack), np.linalg.det(stack), rtol=1e-9)
    assert matrices.length(stack) == pytest.approx(np.linalg.norm(stack), rel=1e-14)
    assert_allclose(matrices.straight_line(x, y), np.polyfit(x, y, 1), rtol=1e-9)


def test_a_matrix_that_cannot_be_taken_apart_is_told_as_by_numpy() -> None:
    singular = np.array([[1.0, 2.0], [2.0, 4.0]])
    for function in (matrices.inv, matrices.cholesky, matrices.log_det):
        with pytest.raises(np.linalg.LinAlgError):
            function(singular)
    for function in (matrices.eigh, matrices.pinv):
        with pytest.raises(np.linalg.LinAlgError):
            function(np.array([[1.0, np.nan], [np.nan, 1.0]]))


def test_nothing_but_these_functions_adds_up_in_an_order_of_the_processors() -> None:
    found = [
        f"{path.relative_to(GSE)}:{node.lineno}"
        for path in sorted(GSE.rglob("*.py"))
        if not any(path.relative_to(GSE).is_relative_to(allowed) for allowed in ALLOWED)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if _goes_to_blas(node)
    ]
    assert not found, f"take gse.values.matrices instead of BLAS in {found}"


def _goes_to_blas(node: ast.AST) -> bool:
    """Whether it is ``@``, or a function of numpy that calls BLAS or LAPACK; np.linalg.norm over an axis does not."""
    if isinstance(node, ast.BinOp | ast.AugAssign):
        return isinstance(node.op, ast.MatMult)
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
        return False
    if ast.unparse(node.func.value) == "np.linalg":
        over_an_axis = node.func.attr == "norm" and any(word.arg == "axis" for word in node.keywords)
        return not (over_an_axis or node.func.attr == "LinAlgError")
    if ast.unparse(node.func) == "np.einsum":
        return any(word.arg == "optimize" for word in node.keywords)
    return node.func.attr in OF_BLAS
