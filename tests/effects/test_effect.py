"""What all effects have in common."""

from dataclasses import fields
from inspect import signature

import pytest

from evsdr.effects.effect import Decision, Effect
from evsdr.fitting.deciding import EFFECTS
from evsdr.fitting.settings import Settings

WHENS = "first", "scene", "anew", "alone", "together", "settled", "last"


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: type(effect).__name__)
def test_each_keeps_the_protocol(effect):
    assert effect.when in WHENS and effect.name
    assert effect.option in {"", *(field.name for field in fields(Settings))}
    for name in ("decide", "model"):
        assert (
            list(signature(getattr(effect, name)).parameters)
            == list(signature(getattr(Effect, name)).parameters)[1:]
        )


def test_their_order_is_that_of_a_fit():
    whens = [WHENS.index(effect.when) for effect in EFFECTS]
    assert whens == sorted(whens)


def test_decisions_share_nothing():
    first, second = Decision("a", False, "why"), Decision("b", False, "why")
    assert first.found == {} and first.found is not second.found and first.expected_deg is None
