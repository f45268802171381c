"""What a camera's recording holds, for a user who does not know yet how the ring ran."""

import numpy as np

from evsdr.rig.camera_file import CameraRecording

BINS = (
    1 << 14
)  # of the event rate, in which repetition is looked for; measured: rings come back from 3 rounds on
LEAST_BIN_US = 100
TILES = 4  # along each side of the image: LEDs that light it as brightly from elsewhere differ
CLEAR = 6.0  # times the scatter of chance: none of 1000 correlations is that large
ALIKE = 0.9  # of the best correlation, from which a shorter period counts as well; guessed
REPEATS = 0.5  # correlation from which events are said to repeat; guessed


def rows(camera: CameraRecording) -> list[tuple[str, str]]:
    """Give lines of a table: size, events, edges of each trigger input, and after which time events repeat."""
    events, edges = camera.events, camera.edges
    first, last = events.t[[0, -1]]
    seconds = 1e-6 * (last - first)
    pixel = np.zeros((camera.height, camera.width), bool)
    pixel[events.y, events.x] = True
    told = [
        ("sensor", f"{camera.width} x {camera.height} pixels"),
        ("events", f"{len(events):,}"),
        ("time", f"{1e-6 * first:.6f} s to {1e-6 * last:.6f} s"),
        ("events per second, mean", f"{1e-6 * len(events) / max(seconds, 1e-6):.3g} M"),
        ("ON events", f"{events.p.mean():.1%}"),
        ("pixels that fire", f"{pixel.mean():.1%}"),
    ]
    for name, polarity in (("rising", 1), ("falling", 0)):
        for number in np.unique(edges.id[edges.p == polarity]):
            t = edges.t[(edges.p == polarity) & (edges.id == number)]
            apart = f", {1e-3 * np.median(np.diff(t)):.6g} ms apart" if len(t) > 1 else ""
            told.append((f"trigger input {number}, {name}", f"{len(t):,} from {1e-6 * t[0]:.6f} s{apart}"))
    if not len(edges):
        told.append(("triggers", "none"))
    period_us = repetition_us(camera)
    return told + [("events repeat every", f"about {1e-3 * period_us:.4g} ms" if period_us else "not found")]


def repetition_us(camera: CameraRecording) -> float | None:
    """Give the shortest time after which the event rates of all parts of the image repeat, None where they do not."""
    t = camera.events.t - camera.events.t[0]
    width = max((int(t[-1]) + 1) / BINS, LEAST_BIN_US)
    n = int(t[-1] / width) + 1
    if n < 16:
        return None
    x, y = (values.astype(np.int64) for values in (camera.events.x, camera.events.y))
    part = TILES * (y * TILES // camera.height) + x * TILES // camera.width
    rate = (
        np.bincount(part * n + (t / width).astype(np.int64), minlength=TILES**2 * n)
        .reshape(-1, n)
        .astype(float)
    )
    mean = rate.mean(axis=1, keepdims=True)
    chance = np.sqrt((mean**2).sum() / (n // 2))  # scatter of a correlation of counts that don't repeat
    rate -= mean
    power = (np.abs(np.fft.rfft(rate, 2 * n)) ** 2).sum(axis=0)
    correlation = np.fft.irfft(power)[: n // 2] / np.arange(n, n - n // 2, -1)
    correlation[0] -= len(t) / n  # that events are counted at all
    below = np.flatnonzero(correlation < 0)
    if not len(below):
        return None
    start = below[0]  # behind the first hump, which is that of no shift at all
    best = correlation[start:].max()
    if best < max(REPEATS * correlation[0], CLEAR * chance):
        return None
    lag = start + int(np.argmax(correlation[start:] >= ALIKE * best))
    while lag + 1 < len(correlation) and correlation[lag + 1] > correlation[lag]:
        lag += 1
    return lag * width
