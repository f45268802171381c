"""A verdict is the worst of all answers."""

from evsdr.viewing.check import DOUBTFUL, FINE, OPEN, WRONG, Check, verdict


def test_the_worst_answer_counts():
    def of(*states):
        return verdict([Check("a", state, "b") for state in states])

    assert of(FINE, OPEN) == of(OPEN) == "good"
    assert of(FINE, DOUBTFUL, OPEN) == "doubtful"
    assert of(DOUBTFUL, WRONG, FINE) == "contradicted"


def test_a_remedy_follows_what_was_found():
    assert str(Check("a", FINE, "All is well")) == "All is well."
    assert str(Check("a", WRONG, "It is upside down", "turn it")) == "It is upside down: turn it."
