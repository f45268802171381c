"""What a quick fit decides is told as it found it."""

from types import SimpleNamespace

from evsdr.effects.effect import Decision
from evsdr.effects.hypotheses import Finding, images
from evsdr.viewing.check import DOUBTFUL, FINE, OPEN, WRONG
from evsdr.viewing.scene_checks import accuracy, set_up
from tests.support.watched_files import recorded


def looked(contradicted=False, noise=0.05, **decisions):
    fit = SimpleNamespace(
        decisions=decisions, contradicted=contradicted, solution=SimpleNamespace(noise=noise)
    )
    return SimpleNamespace(fit=fit, rounds=True, noisy=noise > 0.12)


def test_what_a_fit_finds_is_told():
    mirrored = Finding(next(images(recorded())), "with that, fitted normals are 1 degrees off")
    told = {"remedy": mirrored.hypothesis.remedy}
    decision = Decision("set-up", False, "contradicted", None, told, mirrored)
    check = set_up(looked(True, **{"set-up": decision}))
    assert check.state == WRONG
    assert str(check).startswith(
        "The image is mirrored in x: with that, fitted normals are 1 degrees off: write 19 - x"
    )
    assert set_up(looked()).state == FINE
    assert set_up(looked(noise=0.2)).state == DOUBTFUL
    assert set_up(looked(True, noise=0.6)).state == WRONG


def test_accuracy_is_told_where_nothing_contradicts():
    look = SimpleNamespace(
        expected=SimpleNamespace(normal_deg=0.512, reflectance=0.0123), n_round=6, fit=True
    )
    assert accuracy(look).state == FINE
    assert "6 rounds tell a pixel alone normals within 0.51° and reflectances within 0.012" in str(
        accuracy(look)
    )
    assert accuracy(SimpleNamespace(expected=None, fit=None)).state == OPEN
