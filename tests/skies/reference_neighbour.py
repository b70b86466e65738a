"""The neighbour technique in plain Python, the steps of [S] in their order: slow, and meant to be read.

What the compiled identifier must answer, object for object and star for star.
"""

import math
from bisect import bisect_left
from itertools import combinations, takewhile

MOST_CANDIDATES = 64
VOTERS, BRIGHT_OBJECTS, STARS_TRIED, FEWEST_VOTES = 10, 15, 12, 2


def angle_urad(a, b):
    """Angle between two directions in microradians, by arctan2 (eq 2-2 in its exact form)."""
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return 1e6 * math.atan2(math.sqrt(sum(c * c for c in cross)), sum(p * q for p, q in zip(a, b, strict=True)))


def onboard_table(stars, widest_rad):
    """Figure 2-5: for each star its neighbours within the field as (whole microradians, star), nearest first."""
    table = [[] for _ in stars]
    for i, k in combinations(range(len(stars)), 2):
        distance = angle_urad(stars[i], stars[k])
        if distance <= 1e6 * widest_rad:
            table[i].append((round(distance), k))
            table[k].append((round(distance), i))
    return [sorted(neighbours) for neighbours in table]


class ReferenceNeighbour:
    """First-fit and best-vote over lists of unit vectors."""

    def __init__(self, stars, table, tolerance_urad, min_fit, alphas):
        self.stars, self.table = stars, table
        self.tolerance_urad, self.min_fit, self.alphas = tolerance_urad, min_fit, alphas

    def first_fit(self, objects):
        """{object: star} of the first catalogue star that reaches Fn and Fn2, else {}."""
        for alpha in range(min(self.alphas, len(objects))):
            distances = self.from_alpha(objects, alpha)
            for star in range(len(self.stars)):
                fit, candidates = self.level_1(star, distances)
                if fit >= self.min_fit:
                    group = self.level_2(objects, candidates, self.min_fit)
                    if group:
                        return {alpha: star, **group}
        return {}

    def best_vote(self, objects):
        """{object: star} of the star with the greatest Fn2 among those with most votes; else what first-fit says."""
        for alpha in range(min(self.alphas, len(objects))):
            distances = self.from_alpha(objects, alpha)
            best = {}
            for star in self.most_voted([(d, k) for d, k in distances if k < BRIGHT_OBJECTS][:VOTERS]):
                fit, candidates = self.level_1(star, distances)
                fewest = max(self.min_fit, len(best))
                if fit >= fewest:
                    group = self.level_2(objects, candidates, fewest)
                    if group:
                        best = {alpha: star, **group}
            if best:
                return best
        return self.first_fit(objects)

    def from_alpha(self, objects, alpha):
        """The other objects as (distance from the alpha star, object), nearest first."""
        return sorted((angle_urad(objects[alpha], objects[k]), k) for k in range(len(objects)) if k != alpha)

    def level_1(self, star, distances):
        """Fn (eq 2-5), and which object may be which neighbour."""
        candidates = [(k, neighbour) for listed, neighbour in self.table[star] for k in self.fitting(listed, distances)]
        return len({neighbour for _, neighbour in candidates}), candidates[:MOST_CANDIDATES]

    def fitting(self, listed, distances):
        """The objects, nearest first, whose distance fits a listed one; those are looked at that lie about it."""
        reach = self.tolerance_urad + 1
        about = distances[bisect_left(distances, (listed - reach,)) :]
        about = takewhile(lambda each: each[0] < listed + reach, about)
        return [k for distance, k in about if abs(listed - distance) < self.tolerance_urad]

    def level_2(self, objects, candidates, fewest):
        """The largest group, of ``fewest`` or more, whose members fit each other pairwise (Fn2, eq 2-6)."""
        agrees = {c: [other for other in candidates if self.agree(objects, c, other)] for c in candidates}
        best, able, tried = [], self.able(agrees, candidates, fewest), []
        while untried := [c for c in able if c not in tried]:
            seed = max(untried, key=lambda c: sum(other in able for other in agrees[c]))
            tried.append(seed)
            group, open_ = [seed], [c for c in able if c in agrees[seed]]
            while open_:
                member = max(open_, key=lambda c: sum(other in open_ for other in agrees[c]))
                group.append(member)
                open_ = [c for c in open_ if c in agrees[member]]
            if len(group) > max(len(best), fewest - 1):
                best = group
                able = self.able(agrees, able, len(best) + 1)
        return dict(best)

    def able(self, agrees, candidates, fewest):
        """Those that can be in a group of ``fewest``: each agrees with enough others that can."""
        able, before = candidates, None
        while able != before:
            before = able
            able = [c for c in able if sum(other in able for other in agrees[c]) + 1 >= fewest]
        return able

    def agree(self, objects, one, other):
        (p, a), (q, b) = one, other
        if p == q or a == b:
            return False
        listed = round(angle_urad(self.stars[a], self.stars[b]))
        return abs(listed - angle_urad(objects[p], objects[q])) < self.tolerance_urad

    def most_voted(self, distances):
        """A pair of stars votes for both where it fits a distance; most votes first, then in catalogue order."""
        votes = [0] * len(self.stars)
        for star, neighbours in enumerate(self.table):
            for listed, _ in neighbours:
                votes[star] += len(self.fitting(listed, distances))
        voted = [star for star in range(len(votes)) if votes[star] >= FEWEST_VOTES]
        return sorted(voted, key=lambda star: -votes[star])[:STARS_TRIED]
