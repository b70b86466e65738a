"""The pivot algorithm in plain Python, the steps of [N] section 4 in their order: slow, and meant to be read."""

import math
from itertools import product

from skies.reference_neighbour import angle_urad

MEMBERS, FEWEST = 4, 3


class ReferencePivot:
    """Both steps over lists: stars brightest first, the neighbours of each star, and its cell."""

    def __init__(self, stars, table, cells, touching, tolerance_urad):
        self.stars, self.table, self.cells, self.touching = stars, table, cells, touching
        self.tolerance_urad = tolerance_urad

    def search(self, angles_urad, magnitudes_fit=lambda members, group, zero_from=None: True):
        """("found", {object: star}), ("none", {}) or ("tie", {}) from the angles between objects, brightest first."""
        count, outcome = len(angles_urad), "none"
        for pivot in range(count - FEWEST + 1):
            members = list(range(pivot, min(pivot + MEMBERS, count)))
            groups = [g for g in self.groups(members, angles_urad) if magnitudes_fit(members, g)]
            scored = [(self.concurrence(members, g, angles_urad), g) for g in groups]
            best = max((score for score, _ in scored), default=None)
            leaders = [g for score, g in scored if score == best]
            if len({g[0] for g in leaders}) > 1:
                outcome = "tie"
            elif leaders:
                return "found", self.with_others(members, leaders[0], angles_urad, magnitudes_fit)
        return outcome, {}

    def groups(self, members, angles_urad):
        """Step 1: each star with dimmer stars (pointer 2) at the distance of each member, most of which concur."""
        pivot = members[0]
        found = []
        for star, neighbours in enumerate(self.table):
            dimmer = [(d, k) for d, k in neighbours if k > star]
            candidates = []
            for member in members[1:]:
                candidates.append([(d, k) for d, k in dimmer if self.near(d, angles_urad[pivot][member])])
                if not candidates[-1]:
                    break
            if not candidates[-1]:
                continue
            for pairs in product(*candidates):
                group = (star, *(k for _, k in pairs))
                if len(set(group)) == len(group) and self.concurrence(members, group, angles_urad)[0] >= len(group) - 2:
                    found.append(((pairs[0][0], star, pairs[0][1], *pairs[1:]), group))
        return [group for _, group in sorted(found)]

    def concurrence(self, members, group, angles_urad):
        """How many mutual distances of the members fit, and in how many of these the brighter star is the brighter."""
        fitting = [
            (group[j], group[i])
            for i in range(1, len(group))
            for j in range(1, i)
            if self.stars_fit(group[j], group[i], angles_urad[members[j]][members[i]])
        ]
        return len(fitting), sum(a < b for a, b in fitting)

    def with_others(self, members, group, angles_urad, magnitudes_fit):
        """Step 2: the other objects, each by the one star in the cells around that fits the first three."""
        named = dict(zip(members, group, strict=True))
        near = {cell for star in group for cell in self.touching[self.cells[star]]}
        for other in range(len(angles_urad)):
            if other in members:
                continue
            stars = [
                k
                for d, k in self.table[group[0]]
                if self.cells[k] in near
                and self.near(d, angles_urad[other][members[0]])
                and all(self.stars_fit(k, group[i], angles_urad[other][members[i]]) for i in range(1, FEWEST))
            ]
            if len(stars) == 1 and stars[0] not in named.values() and magnitudes_fit([other], stars, (members, group)):
                named[other] = stars[0]
        return named

    def stars_fit(self, a, b, wanted_urad):
        return self.near(round(angle_urad(self.stars[a], self.stars[b])), wanted_urad)

    def near(self, listed, wanted):
        return abs(listed - wanted) < self.tolerance_urad


def magnitude_gate(object_magnitudes, star_magnitudes, gate, zero_point=None):
    """The Match Group Algorithm's condition: stars within ``gate``, with a zero point given or the group's mean."""

    def fit(members, group, zero_from=None):
        from_members, from_group = zero_from or (members, group)
        differences = [star_magnitudes[s] - object_magnitudes[m] for m, s in zip(from_members, from_group, strict=True)]
        zero = math.fsum(differences) / len(differences) if zero_point is None else zero_point
        return all(
            abs(object_magnitudes[m] + zero - star_magnitudes[s]) <= gate for m, s in zip(members, group, strict=True)
        )

    return fit
