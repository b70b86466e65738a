"""The names that the sensor gives to stars (STARS messages), beside what the panoramas show that they name.

A list and its panorama come in any order, and are brought together by the time tag, or where there is none by the frame
number. A panorama says which star an object is where its answer is correct.
"""

from collections import defaultdict, deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.catalog.stars import ListedStars
from gse.station.columns import ANSWER_CHECKS
from gse.station.frame_results import FrameResults
from gse.station.results import AnswerCheck
from protocols import StarsMessage

STAR_NAME = np.dtype(
    [("utc_ns", "i8"), ("list", "u4"), ("object", "u2"), ("number", "i8"), ("star", "i4"), ("residual_arcsec", "f4")]
)
"""One row per name: the mid-exposure of its panorama, the number of its list in the session, the object, the sensor's
number of the star, the row of the mission catalogue that the object is, -1 where nobody knows, and the residual that
the sensor states, NaN where it states none."""
NO_NAMES = np.zeros(0, STAR_NAME)
MOST_NAMES = 1_000_000
"""Two hours of fourteen stars at 10 Hz; those that follow are left out."""
_MOST_WAITING = 8192
_LARGEST_NUMBER, _LARGEST_OBJECT = 2**63 - 1, 2**16 - 1
_CORRECT = ANSWER_CHECKS.index(AnswerCheck.CORRECT)


class _Frame(NamedTuple):
    """A panorama: its instant, and the row of the catalogue of each object that is known, by its place on the wire."""

    utc_ns: int
    star_of: dict[int, int]


class StarNames:
    """Brings the lists of a session and its panoramas together, each in its order."""

    def __init__(self, rows: NDArray[np.void] = NO_NAMES) -> None:
        self._lists: dict[int, deque[StarsMessage]] = defaultdict(deque)
        self._frames: dict[int, deque[_Frame]] = defaultdict(deque)
        self._parts = [rows]
        self._names, self._paired = len(rows), 0

    @property
    def rows(self) -> NDArray[np.void]:
        """All names so far, rows of STAR_NAME."""
        return np.concatenate(self._parts)

    def snapshot(self) -> "StarNames":
        """The names so far, which later ones do not change."""
        taken = StarNames()
        taken._parts = self._parts.copy()
        return taken

    def between(self, from_ns: int, until_ns: int) -> "StarNames":
        """Those of the panoramas of a stretch of UTC."""
        rows = self.rows
        return StarNames(rows[(rows["utc_ns"] >= from_ns) & (rows["utc_ns"] < until_ns)])

    def take_list(self, message: StarsMessage) -> None:
        """Take a list of the sensor."""
        if not message.problems:
            self._lists[message.time_us or message.frame_no].append(message)
            self._pair(message.time_us or message.frame_no)

    def take_results(self, results: FrameResults) -> None:
        """Take panoramas with their answers."""
        matches, panoramas, checks = results.matches, results.panoramas, results.answer_check
        for k, (time_us, frame_no) in enumerate(
            zip(panoramas.time_us.tolist(), panoramas.frame_no.tolist(), strict=True)
        ):
            rows = matches.parts.rows(k) if checks[k] == _CORRECT else slice(0)
            on_wire = panoramas.wire_rows[panoramas.parts.rows(k)].take(matches.objects[rows])
            known = dict(zip(on_wire.tolist(), matches.stars[rows].tolist(), strict=True))
            self._frames[time_us or frame_no].append(_Frame(int(panoramas.utc_ns[k]), known))
            self._pair(time_us or frame_no)

    def _pair(self, key: int) -> None:
        """Pair what came with the first of the other kind that has its key, or let it wait."""
        lists, frames = self._lists[key], self._frames[key]
        while lists and frames:
            self._add(lists.popleft(), frames.popleft())
        for side in (self._lists, self._frames):
            if not side[key]:
                del side[key]
            if len(side) > _MOST_WAITING:
                del side[next(iter(side))]

    def _add(self, names: StarsMessage, frame: _Frame) -> None:
        self._paired += 1
        if self._names >= MOST_NAMES:
            return
        rows = np.zeros(len(names.stars), STAR_NAME)
        rows["utc_ns"], rows["list"], rows["residual_arcsec"] = frame.utc_ns, self._paired, np.nan
        rows["object"] = [min(max(one, 0), _LARGEST_OBJECT) for one in names.objects]
        rows["number"] = [min(max(one, -_LARGEST_NUMBER), _LARGEST_NUMBER) for one in names.stars]
        rows["star"] = [frame.star_of.get(one, -1) for one in names.objects]
        if names.residuals_arcsec:
            rows["residual_arcsec"] = names.residuals_arcsec
        self._names += len(rows)
        self._parts.append(rows)


# What the names are worth.

_MOST_WRONG = 5


@dataclass(frozen=True, slots=True)
class WrongName:
    """A number that was given to another star than its own: to which, and how often."""

    number: int
    given_to: str
    names: int


@dataclass(frozen=True, slots=True)
class NamedStars:
    """The names of ``lists``: of those whose object is ``known``, how many are ``wrong``, in how many lists.

    Where the numbers are those of the mission catalogue, one of another star is wrong, and of one that it lacks nothing
    is known. Else they are the sensor's own (``own_numbers``): each is that of the star to which it is given most
    often, so that a star which has always the name of another one is not found. ``residual_arcsec`` is the root mean
    square of those that the sensor states, ``most`` are the wrong names that came most often.
    """

    lists: int
    names: int
    known: int
    known_lists: int
    wrong: int
    wrong_lists: int
    own_numbers: bool
    residual_arcsec: float
    most: tuple[WrongName, ...]

    def __str__(self) -> str:
        return f"{self.wrong} of {self.known}, in {self.wrong_lists} of {self.known_lists} lists"


def judged_names(rows: NDArray[np.void], stars: ListedStars) -> tuple[NDArray[np.bool_], NDArray[np.bool_], bool]:
    """Of which of rows (N,) of STAR_NAME the star is known, which are wrong, and whether the numbers are the sensor's
    own."""
    is_known, is_wrong = rows["star"] >= 0, np.zeros(len(rows), dtype=np.bool_)
    known = rows[is_known]
    numbers = np.unique(known["number"])
    own_numbers = bool(2 * np.isin(numbers, stars.ids).sum() < len(numbers))
    if own_numbers:
        pairs, count = np.unique(known[["number", "star"]], return_counts=True)
        order = np.lexsort((pairs["star"], -count, pairs["number"]))
        first = order[np.unique(pairs["number"][order], return_index=True)[1]]
        is_wrong[is_known] = known["star"] != pairs["star"][first][np.searchsorted(numbers, known["number"])]
    else:
        is_known &= np.isin(rows["number"], stars.ids)
        is_wrong[is_known] = rows["number"][is_known] != stars.ids[rows["star"][is_known]]
    return is_known, is_wrong, own_numbers


def named_stars(rows: NDArray[np.void], stars: ListedStars | None) -> NamedStars | None:
    """What rows of STAR_NAME are worth; None where there are none."""
    if not len(rows) or stars is None:
        return None
    is_known, is_wrong, own_numbers = judged_names(rows, stars)
    known, wrong = rows[is_known], rows[is_wrong]
    pairs, count = np.unique(wrong[["number", "star"]], return_counts=True)
    most = [
        WrongName(int(pairs["number"][k]), stars.name(int(pairs["star"][k])), int(count[k]))
        for k in np.argsort(-count, kind="stable")[:_MOST_WRONG]
    ]
    stated = rows["residual_arcsec"][np.isfinite(rows["residual_arcsec"])].astype(np.float64)
    return NamedStars(
        lists=len(np.unique(rows["list"])),
        names=len(rows),
        known=len(known),
        known_lists=len(np.unique(known["list"])),
        wrong=len(wrong),
        wrong_lists=len(np.unique(wrong["list"])),
        own_numbers=own_numbers,
        residual_arcsec=float(np.sqrt((stated**2).mean())) if len(stated) else float("nan"),
        most=tuple(most),
    )
