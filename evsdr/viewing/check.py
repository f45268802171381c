"""A question that a recording was asked, its answer in plain words, and the verdict on all."""

from dataclasses import dataclass

FINE, DOUBTFUL, WRONG, OPEN = "fine", "doubtful", "contradicted", "not told"
VERDICT = {FINE: "good", DOUBTFUL: "doubtful", WRONG: "contradicted"}


@dataclass(frozen=True)
class Check:
    """One question that a recording was asked.

    Attributes
    ----------
    name : str
    state : str
        `FINE`, `DOUBTFUL`, `WRONG`, or `OPEN` where nothing tells.
    said : str
        What was found.
    remedy : str
        What to do about it, if anything.
    """

    name: str
    state: str
    said: str
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.said}: {self.remedy}." if self.remedy else f"{self.said}."


def verdict(checks: list[Check]) -> str:
    """Sum up."""
    states = {check.state for check in checks}
    return VERDICT[next(s for s in (WRONG, DOUBTFUL, FINE) if s in states or s == FINE)]
