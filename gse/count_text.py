"""Numbers of things, as a person reads them."""


def count_text(number: int, what: str) -> str:
    """A number of things in words: 1 night, 2 nights."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
