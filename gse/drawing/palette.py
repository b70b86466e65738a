"""Colours of views and report: those of Okabe and Ito, distinguishable with colour blindness."""

SKY_BLUE = (86, 180, 233)
BLUE = (0, 114, 178)
GREEN = (0, 158, 115)
YELLOW = (240, 228, 66)
ORANGE = (230, 159, 0)
VERMILLION = (213, 94, 0)
PINK = (204, 121, 167)
GREY = (140, 140, 140)
PALE = (90, 90, 90)


def hex_of(colour: tuple[int, int, int]) -> str:
    """The colour as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
