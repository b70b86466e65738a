"""Numbers as a person reads them: counts of things, shares."""


def count_text(number: int, what: str) -> str:
    """A number of things in words: 1 night, 2 nights."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def percent(share: float, decimals: int, *, sign: bool = False) -> str:
    """A share of 1 with its unit, the space that the SI asks for between them."""
    return f"{100 * share:{'+' if sign else ''}.{decimals}f} %"
