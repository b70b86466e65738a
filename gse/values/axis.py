"""The axes along which an attitude error is given: on the sky, and in the frame of the sensor.

On the sky they are right ascension (times cos DE, so that it is an angle on the sky at any declination), declination
and roll: these have limits. Across the boresight along columns and rows, x and y, they are the sensor's own: its
metrics are given so, for the same error of a lens stays on one of them while the sky turns.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis: its ``key`` in columns, reports and keys of a station file, and its ``label`` for a person.

    An axis that ``wraps`` has errors up to half a turn to either side, so that +-180 deg are the same.
    """

    key: str
    label: str
    unit: str = "arcsec"
    wraps: bool = False

    @property
    def column(self) -> str:
        """The name of a column of its errors, and of the key of its limit."""
        return f"{self.key}_{self.unit}"


D_RA_COSDE = Axis("d_ra_cosde", "dRA*")
D_DE = Axis("d_de", "dDE")
D_ROLL = Axis("d_roll", "roll", wraps=True)
CROSS_X = Axis("cross_x", "x")
CROSS_Y = Axis("cross_y", "y")

AXES = (D_RA_COSDE, D_DE, D_ROLL)
"""The axes that have a limit and an uncertainty of truth."""
ON_SKY = (D_RA_COSDE, D_DE)
"""The axes of the direction in which the boresight points."""
OF_SENSOR = (CROSS_X, CROSS_Y, D_ROLL)
"""The axes of the sensor; roll is the same in both frames."""
ALL_AXES = (*AXES, CROSS_X, CROSS_Y)
"""All axes, in the order of the columns of an attitude error."""
