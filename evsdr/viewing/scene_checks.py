"""What a scene tells of a recording, in plain sentences with remedies."""

from evsdr.viewing.check import DOUBTFUL, FINE, OPEN, WRONG, Check
from evsdr.viewing.look import Look


def set_up(look: Look) -> Check:
    """Do image, order of the LEDs and events go with the scene?"""
    name, found = "scene", look.fit
    if look.rounds is None:
        return Check(name, OPEN, "Without a schedule nothing can be compared with a scene")
    if found is None:
        return Check(
            name, OPEN, "Swapped LEDs and a mirrored image can't be seen without a scene", "give scene.xml"
        )
    told, wiring = found.decisions.get("set-up"), found.decisions.get("wiring")
    if told is not None and told.answer is not None:
        return Check(name, WRONG, sentence(str(told.answer)), told.found["remedy"])
    if wiring is not None and wiring.modelled:
        remedy = wiring.answer.hypothesis.remedy
        return Check(name, DOUBTFUL, sentence(str(wiring.answer)), remedy)
    noise = found.solution.noise
    said = f"the best maps leave {noise:.1%} of a threshold unexplained of an event"
    if found.contradicted:
        return Check(
            name, WRONG, sentence(said), "check order, slot_us, triggers, thresholds and constant_light"
        )
    if look.noisy:
        return Check(
            name,
            DOUBTFUL,
            sentence(f"{said}, where 4 to 8 % are usual"),
            "see what else is odd, and the thresholds",
        )
    return Check(name, FINE, f"It goes with the events: {said}")


def accuracy(look: Look) -> Check:
    """What may a fit be expected to give?"""
    name, found = "expected accuracy", look.expected
    if found is None:
        why = (
            "Without a scene nobody can tell" if look.fit is None else "Mend what contradicts the files first"
        )
        return Check(name, OPEN, why)
    more = f"normals within {found.normal_deg:.2g}° and reflectances within {found.reflectance:.2g} at best (1 sigma, median)"
    return Check(name, FINE, f"{look.n_round} rounds tell a pixel alone {more}")


def sentence(text: str) -> str:
    """Begin with a capital, and end without a full stop."""
    return (text[:1].upper() + text[1:]).rstrip(".")
