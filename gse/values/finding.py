"""A finding: one cause of what a session shows, with its size and what to do."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One cause, for the operator. The limits decide, not a finding; a mistake of the set-up may excuse what they say.

    ``cause`` is the head word, the same for all sizes (docs/troubleshooting.md has an entry for each). ``size`` says it
    in the unit that an operator turns, ``equals`` are causes that the session cannot tell apart from it, and
    ``next_step`` is what to do, with a command. ``is_gross`` causes are mistakes of the set-up: degrees, not
    arcseconds.
    """

    cause: str
    size: str
    equals: tuple[str, ...] = ()
    next_step: str = ""
    is_gross: bool = False

    def __str__(self) -> str:
        """One line."""
        equals = f"; this session cannot tell it apart from: {', '.join(self.equals)}" if self.equals else ""
        following = f"; next: {self.next_step}" if self.next_step else ""
        return f"{self.cause}: {self.size}{equals}{following}"
