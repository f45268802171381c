"""What the page of `evsdr.view` shows, as numbers: pictures, charts, and the events of each pixel."""

from dataclasses import asdict

import numpy as np

from evsdr.page.codec import pack
from evsdr.page.contents import laid_out, numbers
from evsdr.viewing.look import Look
from evsdr.viewing.schedule import SHIFTS

FORMAT = "evsdr view 1"
MOST_EVENTS = 1_500_000  # that the page holds: 5 MB
MOST_OF_A_PIXEL = 65535
MOST_LIGHTS = 12_000_000  # modelled lights (pixel, LED)
N_RATE, N_BEAT = 600, 700  # points of charts
LIT, HOT, SILENT, SATURATED, STORED = 1, 2, 4, 8, 16  # bits of the layer `state`


def contents(look: Look, most_events: int = MOST_EVENTS) -> dict:
    """Collect what the scripts of the page read; plain numbers, texts, lists and dicts."""
    watched = look.watched
    end_us, step = window(look, most_events)
    layers, stored = event_layers(look, end_us, step)
    begin = int(watched.events.t[0])
    return {
        "format": FORMAT,
        "height": watched.sensor.height,
        "width": watched.sensor.width,
        "begin_us": begin,
        "window_us": end_us - begin,
        "stride": step,
        "rate": rate(look),
        "triggers": trigger_chart(look),
        "schedule": schedule(look),
        "beat": beat(look),
        "layers": {name: asdict(layer) for name, layer in (layers | thresholds(look) | light(look)).items()},
        "n_stored": int(np.count_nonzero(stored)),
    }


def window(look: Look, most: int) -> tuple[int, int]:
    """Choose until when [us], and of every how manieth row and column, events are stored: whole rounds if that goes."""
    t = look.watched.events.t
    if len(t) <= most:
        return int(t[-1]) + 1, 1
    end = int(t[most])
    if look.rounds is None:
        return end, 1
    round_us = look.rounds.schedule.slot_us * len(look.rounds.schedule.order)
    n_round = int((end - look.begin_us) / round_us)
    if n_round:
        return int(look.begin_us + n_round * round_us), 1
    end = int(look.begin_us + round_us)
    n_event = int(np.searchsorted(t, end))
    return end, int(np.ceil(np.sqrt(n_event / most)))


def event_layers(look: Look, end_us: int, step: int) -> tuple[dict, np.ndarray]:
    """Pack pictures and events, pixel after pixel; gives also which pixels (n_pixel,) have theirs stored."""
    events, pixels, (height, width) = look.watched.events, look.pixels, look.watched.shape
    row, column = np.divmod(np.arange(height * width), width)
    stored = (row % step == 0) & (column % step == 0)
    pixel = events.y.astype(np.int64) * width + events.x
    kept = np.flatnonzero(stored[pixel] & (events.t < end_us))
    kept = kept[np.argsort(pixel[kept], kind="stable")]
    count = np.bincount(pixel[kept], minlength=height * width)
    begin = np.cumsum(count) - count
    kept = kept[np.arange(len(kept)) - begin[pixel[kept]] < MOST_OF_A_PIXEL]
    count = np.minimum(count, MOST_OF_A_PIXEL)
    flags = {LIT: pixels.lit, HOT: pixels.hot, SILENT: pixels.silent, SATURATED: pixels.saturated}
    state = STORED * stored + sum(bit * flag.ravel() for bit, flag in flags.items())
    first = int(events.t[0])
    whole = {"extremes": (0, MOST_OF_A_PIXEL)}
    return {
        "state": pack(state, bits=8, extremes=(0, 255)),
        "on": pack(np.minimum(pixels.on.ravel(), MOST_OF_A_PIXEL), **whole),
        "off": pack(np.minimum(pixels.off.ravel(), MOST_OF_A_PIXEL), **whole),
        "count": pack(count, **whole),
        "time": pack(events.t[kept] - first, extremes=(0, float(end_us - first))),
        "polarity": pack(events.p[kept], bits=8, extremes=(0, 255)),
    }, stored


def thresholds(look: Look) -> dict:
    """Pack the threshold of ON events of each pixel: as told, or as the quick fit has it."""
    told = np.broadcast_to(look.watched.sensor.contrast_threshold_on, look.watched.shape).ravel().copy()
    if look.fit is not None and look.fit.solution.threshold_gain is not None and look.fit.signals is not None:
        told[look.fit.signals.pixel] *= look.fit.solution.threshold_gain[:, 0]
    return {"threshold": pack(told)}


def light(look: Look) -> dict:
    """Pack the light of each LED in each pixel as the quick fit has it, constant light included."""
    signals = look.fit.signals if look.fit is not None else None
    n_pixel = look.watched.sensor.height * look.watched.sensor.width
    if signals is None or n_pixel * signals.modelled.shape[1] > MOST_LIGHTS:
        return {}
    modelled = laid_out(signals, signals.modelled, np.ones(n_pixel, bool))
    there = np.zeros(n_pixel)
    there[signals.pixel] = 1
    return {
        "light": pack(modelled, bits=8, scale="log"),
        "modelled": pack(there, bits=8, extremes=(0, 255)),
    }


def rate(look: Look) -> dict:
    """Count OFF and ON events over time, a second."""
    events = look.watched.events
    begin, end = float(events.t[0]), float(events.t[-1]) + 1
    step = (end - begin) / N_RATE
    place = ((events.t - begin) / step).astype(np.int64)
    count = np.bincount(events.p.astype(np.int64) * N_RATE + place, minlength=2 * N_RATE).reshape(2, N_RATE)
    off, on = numbers(np.round(count / (1e-6 * step), 1))
    return {"step_s": 1e-6 * step, "on": on, "off": off}


def trigger_chart(look: Look) -> dict | None:
    """Give how far each trigger lies from an even grid."""
    found = look.triggers
    if found is None:
        return None
    return {
        "index": numbers(found.index),
        "deviation_us": numbers(np.round(found.deviation_us, 2)),
        "missing": numbers(found.missing),
        "edge_us": numbers(found.edge_us),
        "stray_us": numbers(found.stray_us),
    }


def schedule(look: Look) -> dict | None:
    """Give the schedule that is believed, with events of each slot, and how well it fits when it is shifted."""
    found = look.rounds
    if found is None:
        return None
    plan = found.schedule
    knots = look.begin_us + np.arange(look.n_round + 1) * plan.slot_us * len(plan.order)
    off, on = numbers(look.per_slot)
    return {
        "order": numbers(plan.order),
        "slot_us": plan.slot_us,
        "crossfade": plan.crossfade,
        "start_us": numbers(found.starts if len(found.starts) else knots),
        "on": on,
        "off": off,
        "shift": numbers(SHIFTS),
        "coherence": numbers(np.round(found.shift, 5)),
    }


def beat(look: Look) -> dict:
    """Give how far events keep time with each frequency, the most of each of `N_BEAT` ranges."""
    hz, power = look.beat
    edge = np.linspace(0, len(hz), min(N_BEAT, len(hz)) + 1).astype(int)[:-1]
    highest = np.maximum.reduceat(power, edge)
    return {
        "hz": numbers(np.round(hz[edge], 2)),
        "power": numbers(np.round(highest, 4)),
        "against": look.flicker is not None,
        "n": look.flicker.n if look.flicker is not None else len(look.watched.events),
    }
