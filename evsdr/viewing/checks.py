"""What a user should know of a recording, in plain sentences: each finding with its remedy, and a verdict on all."""

from dataclasses import replace

import numpy as np

from evsdr.records import Events, Recording
from evsdr.rig import health
from evsdr.viewing.check import DOUBTFUL, FINE, OPEN, WRONG, Check
from evsdr.viewing.look import Look
from evsdr.viewing.scene_checks import accuracy, set_up

LISTED = 5  # rounds or times that a sentence names
UNSTEADY = 0.003  # share of events against the grain; measured: clean 0.0002, a lamp 0.006 to 0.15
NOISE = 0.05  # the same where they keep time with nothing
JITTER = 1e-3  # of a round
OUTSIDE = 0.05  # of the events
MANY = 0.05  # of the lit pixels, that are saturated; hard switches leave 0.01
HOT = 1e-3  # of the pixels


def examine(look: Look) -> list[Check]:
    """Ask all questions."""
    questions = (amount, triggers, schedule, leds, room_light, saturation, hot_and_silent, set_up, accuracy)
    return [question(look) for question in questions]


def amount(look: Look) -> Check:
    """Are there enough events, and not too many?"""
    n, seconds, lit = len(look.watched.events), look.watched.seconds, look.pixels.lit
    said = f"{n:,} events in {seconds:.2f} s, {n / seconds / 1e6:.2g} M a second; {lit.mean():.1%} of the pixels see the light"
    if n < look.watched.n_event:
        said = f"of {look.watched.n_event:,} events the first " + said
    if look.rounds is None or look.n_round < 1:
        return Check(
            "events", FINE if lit.any() else DOUBTFUL, said, "" if lit.any() else "switch the ring on"
        )
    recording, begin = steady(look), look.begin_us
    last = recording.schedule.slot_us * len(recording.schedule.order) * look.n_round + begin
    figures = health.examine(recording, look.n_round, min(begin, recording.events.t[0]), last)
    said += f"; {figures.events_per_pixel_round:.0f} of each lit pixel in each of {look.n_round} rounds"
    hints = health.hints(figures, recording)
    return Check("events", DOUBTFUL if hints else FINE, said, " ".join(hints).rstrip("."))


def steady(look: Look) -> Recording:
    """Give the recording without hot pixels."""
    events = look.watched.events
    kept = ~look.pixels.hot[events.y, events.x]
    events = Events(events.x[kept], events.y[kept], events.p[kept], events.t[kept])
    return replace(look.recording, events=events)


def triggers(look: Look) -> Check:
    """Are the starts of the rounds regular, and all there?"""
    found, name = look.triggers, "triggers"
    if found is None:
        if look.watched.schedule is None:
            t = look.watched.starts
            one = f"The file has one trigger, at {1e-6 * t[0]:.6f} s, which tells no round" if len(t) else ""
            return Check(name, OPEN, one or "The file has no triggers")
        first = "There is one: it" if len(look.watched.starts) else "There are none: start_us of the schedule"
        return Check(name, FINE, f"{first} and an even clock count the rounds")
    jitter = float(np.abs(found.deviation_us).max())
    said = f"{len(found.edge_us)} triggers, every {1e-3 * found.round_us:.6g} ms within {jitter:.0f} us"
    missing, stray = found.missing, found.stray_us
    events, last = look.watched.events, found.edge_us[-1]
    outside = np.mean((events.t < found.edge_us[0]) | (events.t > last))
    if len(missing):
        rounds = ", ".join(str(k + 1) for k in missing[:LISTED])
        more = " and more" if len(missing) > LISTED else ""
        said += f"; the start of round {rounds}{more} has none and is put where the others say"
    if len(stray):
        seconds = ", ".join(f"{1e-6 * t:.4f} s" for t in stray[:LISTED])
        said += f"; {len(stray)} start no round (at {seconds})"
    if outside > OUTSIDE:
        said += f"; {outside:.0%} of the events lie before the first or after the last and count for nothing"
    bad = len(missing) or len(stray) or outside > OUTSIDE
    if bad:
        return Check(
            name,
            DOUBTFUL,
            said,
            "check the wire of the trigger, its level and its ground, and record all rounds",
        )
    if jitter > JITTER * found.round_us:
        return Check(name, DOUBTFUL, said, "look for what delays the ring")
    return Check(name, FINE, said)


def schedule(look: Look) -> Check:
    """Does the schedule fit the events?"""
    found, name = look.rounds, "schedule"
    again = (
        f"events come again every {1e-3 * look.period_us:.6g} ms"
        if look.period_us
        else "events never come again"
    )
    if found is None and look.watched.schedule is not None:
        said = "Hardly any pixel fires often enough to tell"
        return Check(name, DOUBTFUL, said, "switch the ring on, open the lens, or lower the thresholds")
    if found is None:
        return Check(
            name,
            OPEN,
            f"The file tells no schedule; {again}",
            "give the ring's log by --ring, or an events.h5 that evsdr.convert made",
        )
    told, believed = look.watched.schedule, found.schedule
    if found.wrong:
        return Check(
            name,
            WRONG,
            f"Slots last {1e-3 * believed.slot_us:.5g} ms, say the events, and {1e-3 * told.slot_us:.5g} ms is told: "
            f"a round of the told length fits them by {found.told:.0%}, the other by {found.believed:.0%}",
            f"write slot_us = {believed.slot_us:.6g} in schedule, if its order holds all LEDs",
        )
    if look.n_round < 1:
        said = "Not one round of the told length lies in the recording"
        return Check(name, WRONG, said, "check start_us, slot_us and the triggers")
    fits = f"{found.coherence:.1%} of the events of a pixel in a slot agree in polarity, over all rounds"
    if found.late_us:
        way = "later" if found.late_us > 0 else "earlier"
        return Check(
            name,
            WRONG,
            f"Rounds don't start when they should: {fits}, but {found.shift.max():.1%} if they "
            f"started {abs(1e-3 * found.late_us):.2g} ms {way}",
            "check start_us, and which edge of the trigger marks a start",
        )
    if not look.period_us:
        return Check(
            name, DOUBTFUL, f"{again.capitalize()} alike", "record more rounds of a surface that rests"
        )
    round_ms = 1e-3 * believed.slot_us * len(believed.order)
    times = round(1e3 * round_ms / look.period_us)
    often = f"{times} times in a round" if times > 1 else "the length of a round"
    return Check(name, FINE, f"It fits: {again}, {often} of {round_ms:.6g} ms, and {fits}")


def leds(look: Look) -> Check:
    """Does each LED give light?"""
    name = "LEDs"
    if look.leds is None:
        return Check(name, OPEN, "Nothing tells which LED gives light")
    if untrusted(look):
        return Check(name, OPEN, "Mend the schedule first")
    dead = look.leds.dead
    if dead:
        one = len(dead) == 1
        names = ", ".join(map(str, dead))
        return Check(
            name,
            DOUBTFUL,
            f"LED{'' if one else 's'} {names} give{'s' if one else ''} no light: while {'it' if one else 'they'} "
            "should shine, hardly any pixel is brighter than in the dark",
            "check the ring; or the surface reflects nothing of that band",
        )
    n = np.count_nonzero(np.isfinite(look.leds.rise))
    return Check(name, FINE, f"All {n} give light")


def room_light(look: Look) -> Check:
    """Is there other light?"""
    name, found = "room light", look.flicker
    if found is None:
        return Check(name, OPEN, "Without a schedule nothing tells the ring's light from other light")
    if untrusted(look):
        return Check(name, OPEN, "Mend the schedule first")
    share = f"{found.share:.1%} of the events go against the light of their slot"
    dim = "switch lamps off, or cover ring and object against them; a constant light must come from direct current"
    if found.share > UNSTEADY and found.mains_hz:
        beat = f"{share} and keep time with {found.mains_hz:g} Hz"
        return Check(name, DOUBTFUL, f"There is room light on the mains: {beat}", dim)
    if found.share > NOISE:
        return Check(
            name, DOUBTFUL, f"Other light, movement, or noise: {share}", "look for what moves or flickers"
        )
    return Check(name, FINE, f"None seen: {share}")


def saturation(look: Look) -> Check:
    """Do pixels keep up with the light?"""
    pixels, name = look.pixels, "saturation"
    n, lit = np.count_nonzero(pixels.saturated), max(np.count_nonzero(pixels.lit), 1)
    refractory = look.watched.sensor.refractory_us
    said = f"{n:,} of {lit:,} lit pixels ({n / lit:.0%}) fire again within twice the refractory period of {refractory:g} us"
    if n > MANY * lit:
        return Check(
            "saturation",
            DOUBTFUL,
            f"Pixels can't keep up: {said}, so that much of the light's change is lost",
            "make slots longer, the refractory period shorter (bias_refr), or the light weaker against the constant light",
        )
    return Check(
        name,
        FINE,
        f"Pixels keep up: {said}; one event in a thousand comes within {pixels.shortest_us:.0f} us",
    )


def hot_and_silent(look: Look) -> Check:
    """Do pixels fire by themselves, or never?"""
    pixels, name = look.pixels, "hot and silent pixels"
    hot, silent = (int(np.count_nonzero(a)) for a in (pixels.hot, pixels.silent))
    said = f"{hot:,} fire far more than their neighbours, {silent:,} never though their neighbours do"
    if hot + silent > HOT * pixels.hot.size and hot + silent > 2:
        return Check(name, DOUBTFUL, said, "mask them in the camera, or record warm and with another bias")
    return Check(name, FINE, said)


def untrusted(look: Look) -> bool:
    """Tell whether slots are not where the schedule says."""
    return look.rounds is None or bool(look.rounds.late_us)
