"""Answer of an identifier, to one panorama or to many."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.values.panorama import Parts


class Reason(StrEnum):
    """Why there is no identification."""

    TOO_FEW = "TOO_FEW"
    NO_MATCH = "NO_MATCH"
    MIRRORED = "MIRRORED"
    """The image is a mirror image of the sky: ``sensor.mirrored`` of the station file is wrong."""
    AMBIGUOUS = "AMBIGUOUS"
    SENSOR_FAULT = "SENSOR_FAULT"


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Objects of a panorama and their stars.

    ``objects`` (M,) are row numbers of the panorama, ``stars`` (M,) row numbers of the identifier's catalogue, in the
    same order; ``false_match_probability`` bounds the probability of such an answer to a panorama of random objects.
    """

    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    false_match_probability: float


@dataclass(frozen=True, slots=True)
class Unidentified:
    """No answer, with its reason; ``detail`` is one line for a person."""

    reason: Reason
    detail: str


def check_shapes(directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64]) -> None:
    """ValueError where directions and brightness do not belong together: that is the caller's fault."""
    shape = directions_sensor.shape
    if directions_sensor.ndim != 2 or shape[1] != 3 or brightness.shape != shape[:1]:
        raise ValueError(
            f"directions came with the shape {shape} and index values with {brightness.shape}; expected (N, 3) and (N,)"
        )


@dataclass(frozen=True, slots=True, eq=False)
class ObjectColumns:
    """Objects of K panoramas as columns: unit vectors (M, 3) and brightness (M,), brightest first in each part."""

    directions_sensor: NDArray[np.float64]
    brightness: NDArray[np.float64]
    parts: Parts

    @classmethod
    def from_panoramas(cls, panoramas: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> Self:
        """The columns of panoramas given one by one; ValueError where shapes do not belong together."""
        for panorama in panoramas:
            check_shapes(*panorama)
        directions, brightness = zip(*panoramas, strict=True) if panoramas else ((np.zeros((0, 3)),), (np.zeros(0),))
        return cls(
            np.concatenate(directions, dtype=np.float64),
            np.concatenate(brightness, dtype=np.float64),
            Parts.of_counts([len(of_one) for _, of_one in panoramas]),
        )

    def __len__(self) -> int:
        return len(self.parts)

    def __iter__(self) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        return (
            (self.directions_sensor[rows], self.brightness[rows]) for rows in map(self.parts.rows, range(len(self)))
        )

    def part(self, begin: int, end: int) -> Self:
        """The panoramas from ``begin`` to before ``end``."""
        parts, rows = self.parts.part(begin, end)
        return type(self)(self.directions_sensor[rows], self.brightness[rows], parts)

    def chosen(self, wanted: NDArray[np.bool_]) -> Self:
        """Those of the panoramas that are wanted (K,)."""
        parts, rows = self.parts.chosen(wanted)
        return type(self)(self.directions_sensor[rows], self.brightness[rows], parts)


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """Answers to K panoramas as columns; ``answers[k]`` is a view of one: Identification or Unidentified.

    ``objects`` (M,) are rows within a panorama and ``stars`` (M,) rows of the catalogue, in parts;
    ``false_match_probability`` is (K,). ``unidentified`` holds the panoramas without an answer, whose parts are empty.
    """

    parts: Parts
    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    false_match_probability: NDArray[np.float64]
    unidentified: Mapping[int, Unidentified]

    @classmethod
    def from_answers(cls, answers: Sequence[Identification | Unidentified]) -> Self:
        """The columns of answers given one by one."""
        found = [answer for answer in answers if isinstance(answer, Identification)]
        nothing = np.zeros(0, dtype=np.int64)
        return cls(
            Parts.of_counts([len(answer.stars) if isinstance(answer, Identification) else 0 for answer in answers]),
            np.concatenate([nothing, *(answer.objects for answer in found)]),
            np.concatenate([nothing, *(answer.stars for answer in found)]),
            np.array([getattr(answer, "false_match_probability", np.nan) for answer in answers], dtype=np.float64),
            {k: answer for k, answer in enumerate(answers) if isinstance(answer, Unidentified)},
        )

    @classmethod
    def joined(cls, some: Sequence[Self]) -> Self:
        """The answers to panoramas of which each of ``some`` has a part, in their order."""
        if len(some) == 1:
            return some[0]
        before = np.cumsum([0, *(len(answers) for answers in some)]).tolist()
        nothing = np.zeros(0, dtype=np.int64)
        return cls(
            Parts.of_counts(np.concatenate([nothing, *(answers.parts.counts for answers in some)])),
            np.concatenate([nothing, *(answers.objects for answers in some)]),
            np.concatenate([nothing, *(answers.stars for answers in some)]),
            np.concatenate([np.zeros(0), *(answers.false_match_probability for answers in some)]),
            {first + k: no for first, one in zip(before, some, strict=False) for k, no in one.unidentified.items()},
        )

    @classmethod
    def none(cls, count: int) -> Self:
        """Of so many panoramas that no identifier was asked for."""
        nothing = np.zeros(0, dtype=np.int64)
        return cls(Parts.of_counts(np.zeros(count, np.int64)), nothing, nothing, np.full(count, np.nan), {})

    def __len__(self) -> int:
        return len(self.parts)

    def __getitem__(self, k: int) -> Identification | Unidentified:
        if (unidentified := self.unidentified.get(k)) is not None:
            return unidentified
        rows = self.parts.rows(k)
        return Identification(self.objects[rows], self.stars[rows], float(self.false_match_probability[k]))

    def __iter__(self) -> Iterator[Identification | Unidentified]:
        return (self[k] for k in range(len(self)))

    @property
    def named(self) -> NDArray[np.bool_]:
        """Which panoramas (K,) are identified."""
        named = np.ones(len(self), dtype=np.bool_)
        named[list(self.unidentified)] = False
        return named

    def part(self, begin: int, end: int) -> Self:
        """The answers from ``begin`` to before ``end``."""
        parts, rows = self.parts.part(begin, end)
        unidentified = {k - begin: answer for k, answer in self.unidentified.items() if begin <= k < end}
        probability = self.false_match_probability[begin:end]
        return type(self)(parts, self.objects[rows], self.stars[rows], probability, unidentified)

    def but(self, unidentified: Mapping[int, Unidentified]) -> Self:
        """The same answers, but none to these panoramas."""
        if not unidentified:
            return self
        parts, rows = self.parts.emptied(list(unidentified))
        return type(self)(
            parts,
            self.objects[rows],
            self.stars[rows],
            self.false_match_probability,
            {**self.unidentified, **unidentified},
        )


def answered(
    objects: ObjectColumns, refused: Mapping[int, Unidentified], search: Callable[[ObjectColumns], Answers]
) -> Answers:
    """The answers of a search to the panoramas that were not refused, among the refusals."""
    if not refused:
        return search(objects)
    sound = np.ones(len(objects), dtype=np.bool_)
    sound[list(refused)] = False
    counts, probability = np.zeros(len(objects), dtype=np.int64), np.full(len(objects), np.nan)
    if not sound.any():
        nothing = np.zeros(0, dtype=np.int64)
        return Answers(Parts.of_counts(counts), nothing, nothing, probability, refused)
    found = search(objects.chosen(sound))
    places = sound.nonzero()[0]
    counts[places], probability[places] = found.parts.counts, found.false_match_probability
    unidentified = {int(places[k]): answer for k, answer in found.unidentified.items()}
    return Answers(Parts.of_counts(counts), found.objects, found.stars, probability, {**refused, **unidentified})
