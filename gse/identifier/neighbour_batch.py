"""Compiled search of the neighbour technique for many panoramas: each object once, answers in one table."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.acceptance import wahba_residual_rad
from gse.identifier.input_checks import distinct_objects
from gse.identifier.neighbour_level_1 import Blocks
from gse.identifier.neighbour_search import Limits, best_vote, first_fit
from gse.identifier.tables import PairTable
from gse.process.jit import compiled, compiled_part


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
        panorama = directions[first[k] : first[k + 1]]
        distinct = distinct_objects(panorama)
        rows = panorama[distinct]
        objects, stars, alphas = first_fit(rows, icrs, table, blocks, limits)
        _put(found, k, distinct[objects], stars, alphas)
        found.rms_rad[k] = _rms_rad(rows[objects], icrs[stars])
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
        panorama = directions[first[k] : first[k + 1]]
        distinct = distinct_objects(panorama)
        rows = panorama[distinct]
        objects, stars, alphas = best_vote(rows, icrs, table, blocks, limits)
        _put(found, k, distinct[objects], stars, alphas)
        found.rms_rad[k] = _rms_rad(rows[objects], icrs[stars])
    return found


@compiled_part
def _room_for_answers(panoramas: int, objects: int) -> Found:
    return Found(
        np.zeros(panoramas + 1, np.int64),
        np.empty(objects, np.int64),
        np.empty(objects, np.int64),
        np.empty(panoramas, np.int64),
        np.empty(panoramas),
    )


@compiled_part
def _put(found: Found, k: int, objects: NDArray[np.int64], stars: NDArray[np.int64], alphas: int) -> None:
    """Put the answer to panorama k into its place.

    One by one: for a slice numba compiles what tells of shapes that do not fit, which takes two seconds.
    """
    begin, end = found.ends[k], found.ends[k] + len(objects)
    for i in range(len(objects)):
        found.objects[begin + i], found.stars[begin + i] = objects[i], stars[i]
    found.ends[k + 1], found.alphas[k] = end, alphas


@compiled_part
def _rms_rad(measured: NDArray[np.float64], stars: NDArray[np.float64]) -> float:
    """As ``wahba_residual_rad``, zero where no star was found."""
    return wahba_residual_rad(measured, stars) if len(measured) > 0 else 0.0
