"""Compiled search of the neighbour technique for many panoramas: each object once, answers in one table."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.acceptance import wahba_residual_rad
from gse.identifier.input_checks import distinct_objects
from gse.identifier.neighbour_level_1 import Blocks
from gse.identifier.neighbour_search import Limits, best_vote, first_fit
from gse.identifier.tables import PairTable
from gse.jit import compiled


class Found(NamedTuple):
    """Answers to K panoramas: objects and stars (M,) of panorama k are ``ends[k]`` to before ``ends[k + 1]``.

    ``alphas`` (K,) is how many alpha stars were tried, ``rms_rad`` (K,) how far the stars are off their objects.
    """

    ends: NDArray[np.int64]
    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    alphas: NDArray[np.int64]
    rms_rad: NDArray[np.float64]


@compiled
def first_fit_many(
    directions: NDArray[np.float64],
    first: NDArray[np.int64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: Limits,
) -> Found:
    """``first_fit`` for K panoramas: rows ``first[k]`` to before ``first[k + 1]``, each object taken once."""
    found = _room_for_answers(len(first) - 1, len(directions))
    for k in range(len(first) - 1):
        distinct, rows = _distinct(directions[first[k] : first[k + 1]])
        objects, stars, alphas = first_fit(rows, icrs, table, blocks, limits)
        _put(found, k, objects, stars, alphas, distinct, rows, icrs)
    return found


@compiled
def best_vote_many(
    directions: NDArray[np.float64],
    first: NDArray[np.int64],
    icrs: NDArray[np.float64],
    table: PairTable,
    blocks: Blocks,
    limits: Limits,
) -> Found:
    """As ``first_fit_many``, by ``best_vote``."""
    found = _room_for_answers(len(first) - 1, len(directions))
    for k in range(len(first) - 1):
        distinct, rows = _distinct(directions[first[k] : first[k + 1]])
        objects, stars, alphas = best_vote(rows, icrs, table, blocks, limits)
        _put(found, k, objects, stars, alphas, distinct, rows, icrs)
    return found


@compiled
def _room_for_answers(panoramas: int, objects: int) -> Found:
    return Found(
        np.zeros(panoramas + 1, np.int64),
        np.empty(objects, np.int64),
        np.empty(objects, np.int64),
        np.empty(panoramas, np.int64),
        np.zeros(panoramas),
    )


@compiled
def _distinct(directions: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Rows of the objects that are no second listing of another one, and their directions."""
    distinct = distinct_objects(directions)
    rows = np.empty((len(distinct), 3))
    for i in range(len(distinct)):
        for axis in range(3):
            rows[i, axis] = directions[distinct[i], axis]
    return distinct, rows


@compiled
def _put(
    found: Found,
    k: int,
    objects: NDArray[np.int64],
    stars: NDArray[np.int64],
    alphas: int,
    distinct: NDArray[np.int64],
    rows: NDArray[np.float64],
    icrs: NDArray[np.float64],
) -> None:
    """Put the answer to panorama k into its place."""
    begin = found.ends[k]
    measured, placed = np.empty((len(objects), 3)), np.empty((len(objects), 3))
    for i in range(len(objects)):
        found.objects[begin + i], found.stars[begin + i] = distinct[objects[i]], stars[i]
        for axis in range(3):
            measured[i, axis], placed[i, axis] = rows[objects[i], axis], icrs[stars[i], axis]
    found.ends[k + 1] = begin + len(objects)
    found.alphas[k] = alphas
    if len(objects) > 0:
        found.rms_rad[k] = wahba_residual_rad(measured, placed)
