"""A share in words: 95.67 %."""


def percent(share: float, decimals: int, *, sign: bool = False) -> str:
    """A share of 1 with its unit, the space that the SI asks for between them."""
    return f"{100 * share:{'+' if sign else ''}.{decimals}f} %"
