"""Dawn: when the sky of a site becomes too bright for stars."""

from gse.instant import NS_PER_S
from gse.site import Site
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.truth.solar_system import sun_altitude_deg

_STEP_NS = 600 * NS_PER_S
_STEPS = 144
_HALVINGS = 10


class NextDawn:
    """The next dawn at a site, looked for anew once the one before is over."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._from_ns, self._dawn_ns = 0, 0

    def minutes(self, utc_ns: int) -> int | None:
        """Whole minutes from an instant to dawn; None where none comes within a day."""
        if not self._from_ns <= utc_ns < self._dawn_ns:
            dawn_ns = next_dawn_ns(self._site, utc_ns)
            if dawn_ns is None:
                return None
            self._from_ns, self._dawn_ns = utc_ns, dawn_ns
        return (self._dawn_ns - utc_ns) // (60 * NS_PER_S)


def next_dawn_ns(site: Site, utc_ns: int) -> int | None:
    """UTC of the next dawn within a day, good to a second; ``utc_ns`` where it is bright, None in polar night."""
    if is_bright(site, utc_ns):
        return utc_ns
    for step in range(1, _STEPS + 1):
        if is_bright(site, utc_ns + step * _STEP_NS):
            return _between(site, utc_ns + (step - 1) * _STEP_NS, utc_ns + step * _STEP_NS)
    return None


def is_bright(site: Site, utc_ns: int) -> bool:
    """Whether the Sun is too high for stars."""
    return sun_altitude_deg(site, utc_ns) > SUN_LIMIT_DEG


def _between(site: Site, dark_ns: int, bright_ns: int) -> int:
    for _ in range(_HALVINGS):
        middle_ns = (dark_ns + bright_ns) // 2
        dark_ns, bright_ns = (dark_ns, middle_ns) if is_bright(site, middle_ns) else (middle_ns, bright_ns)
    return bright_ns
