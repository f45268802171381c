"""What is extreme: groups of cases, each a scene, an event pixel and a schedule."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from evsdr import EventPixel, Recording, Schedule, Settings

from .scenes import Scene

PIXEL = replace(EventPixel().idealised(), event_noise=0.05)


@dataclass(frozen=True)
class Case:
    """One recording and its fit.

    Attributes
    ----------
    group, value : str
        What is extreme, and how.
    scene : Scene
    pixel : EventPixel
    slot_us : float
    dark_every : int
        LEDs between two dark slots; 0 for none.
    rounds : int
    later_us : int
        By which all times are late.
    most_events : int, optional
        Of a pixel; the others are left out.
    settings : Settings
    """

    group: str
    value: str
    scene: Scene = Scene()
    pixel: EventPixel = PIXEL
    slot_us: float = 20_000.0
    dark_every: int = 3
    rounds: int = 3
    later_us: int = 0
    most_events: int | None = None
    settings: Settings = field(default_factory=Settings)

    def schedule(self) -> Schedule:
        """Give which LED is lit when."""
        n, every = self.scene.n_led, self.dark_every
        order = [led for j in range(n) for led in ((-1, j) if every and j % every == 0 else (j,))]
        return Schedule(np.array(order, np.int32), self.slot_us, crossfade=1.0)

    def alter(self, recording: Recording) -> Recording:
        """Move the times, and leave out events."""
        events = recording.events
        if self.most_events is not None:
            pixel = events.y.astype(np.int64) * recording.sensor.width + events.x
            order = np.argsort(pixel, kind="stable")
            first = np.searchsorted(pixel[order], pixel[order])
            kept = np.sort(order[np.arange(len(order)) - first < self.most_events])
            events = replace(events, **{name: getattr(events, name)[kept] for name in "xypt"})
        return replace(
            recording,
            events=replace(events, t=events.t + self.later_us),
            round_start_us=recording.round_start_us + self.later_us,
        )


def cases(large: bool = False) -> Iterator[Case]:
    """Give all cases; `large` adds sizes and numbers of bands that take minutes."""
    yield Case("nothing", "")
    for value in (0.0, 1e-6, 1e-3, 0.05, 1.0, 1e2, 1e3, 1e6):
        yield Case("C_w / LED", f"{value:g}", Scene(constant_light=value))
    for value in (0.0, 1e-3, 5e-3, 0.02, 0.05):
        yield Case("C_w / LED", f"{value:g}, EVK4", Scene(constant_light=value), pixel=EventPixel())
    for value in (1e-5, 1e-3, 0.05, 1.0, 4.0, 6.0):
        yield Case("reflectance", f"{value:g}", Scene(reflectance=value))
    for value in (0.02, 0.1, 0.5, 1.0, 2.0):
        pixel = replace(PIXEL, contrast_threshold_on=value, contrast_threshold_off=value)
        yield Case("threshold", f"{value:g}", pixel=pixel)
    for value in (0.0, 60.0, 80.0, 88.0, 89.9):
        yield Case("tilt [deg]", f"{value:g}", Scene(tilt_deg=value))
    for value in (1, 3, 10, 30):
        yield Case("most events of a pixel", f"{value}", most_events=value)
    small, fine = (
        Scene(width=4, height=4),
        replace(PIXEL, contrast_threshold_on=0.02, contrast_threshold_off=0.02),
    )
    yield Case("most events of a pixel", "1e4", small, replace(fine, refractory_us=5.0), rounds=10)
    yield Case("most events of a pixel", "1e5", small, replace(fine, refractory_us=5.0), rounds=100)
    for name, value in (("2^31", 2**31), ("2^40", 2**40), ("2^53 - 2^20", 2**53 - 2**20), ("2^60", 2**60)):
        yield Case("first time [us]", name, later_us=value)
    for value in (50.0, 500.0, 5e3, 1e6, 1e7):
        yield Case("slot [us]", f"{value:g}", slot_us=value)
    for value in (50.0, 500.0, 2e3, 1e7):
        yield Case("slot [us]", f"{value:g}, EVK4", pixel=EventPixel(), slot_us=value)
    for value in (1.0, 5.0, 20.0, 70.0, 85.0, 89.0):
        yield Case("ring angle [deg]", f"{value:g}", Scene(ring_deg=value))
    for n_led, n_band in ((2, 1), (3, 1), (4, 4), (12, 12), (64, 8)):
        yield Case("LEDs, bands", f"{n_led}, {n_band}", Scene(n_led=n_led, n_band=n_band))
    for n_led, n_band in ((64, 16), (256, 8), (128, 64)) if large else ():
        yield Case("LEDs, bands", f"{n_led}, {n_band}", Scene(width=8, height=8, n_led=n_led, n_band=n_band))
    yield Case("LEDs that a plane sees", "1 of 8", Scene(n_led=8, tilt_deg=10.0, open_led=0))
    for width, height in ((1, 1), (2, 1), (1, 16), (3, 3), (200, 2)):
        yield Case("size", f"{width} x {height}", Scene(width=width, height=height))
    if large:
        yield Case("size", "1280 x 720", Scene(width=1280, height=720))
    for value in (1e-6, 1e-3, 1e3, 1e6):
        yield Case("unit", f"{value:g}", Scene(unit=value))
    for value in (1e-6, 1e-3, 1.0, 1e3, 1e6):
        yield Case("unit, pole, near LEDs", f"{value:g}", Scene(unit=value, pole=True, near=True))
    for value in (1e-12, 1e-6, 1e6, 1e12):
        yield Case("power", f"{value:g}", Scene(power=value))
