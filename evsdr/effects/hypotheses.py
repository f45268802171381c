"""Gross errors of a set-up: what may be told wrong, how that is mended in the files, and what a fit then believes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from evsdr.records import Recording

if TYPE_CHECKING:
    from evsdr.effects.world import World

FACTOR = 10.0  # by which numbers are told wrong: a slip of the decimal point
VEIL = 0.1  # of the brightest LED's signal: constant light where its strength does not matter
HALF_TURN = "the image is turned by 180 degrees"
UNITS = {"ns": 1e-3, "ms": 1e3}  # us in each


@dataclass(frozen=True)
class Hypothesis:
    """One way in which what is told is wrong.

    Attributes
    ----------
    what : str
        It, in words.
    remedy : str
        Which file, which field, which value.
    mend : callable (World) -> World
        Believe it.
    move : callable (height, width, ...) -> array, optional
        What it does to an image.
    leds : tuple of int
        The LEDs at fault, where it speaks of some only; a fit takes it for true without being asked.
    """

    what: str
    remedy: str
    mend: Callable[["World"], "World"]
    move: Callable | None = None
    leds: tuple[int, ...] = ()


@dataclass(frozen=True)
class Finding:
    """The hypothesis that explains what contradicts the files.

    Attributes
    ----------
    hypothesis : Hypothesis
    evidence : str
    others : tuple of str
        What would explain as much.
    """

    hypothesis: Hypothesis
    evidence: str
    others: tuple[str, ...] = ()

    def __str__(self) -> str:
        other = f", or {self.others[0]}" if self.others else ""
        return f"{self.hypothesis.what}{other}: {self.evidence}"


# ---------------------------------------------------------------------- image


def images(recording: Recording) -> Iterator[Hypothesis]:
    """The image lies otherwise than the camera of the scene says."""
    wide, high = recording.sensor.width, recording.sensor.height
    flips = {
        "the image is mirrored in x": (np.fliplr, f"{wide - 1} - x for x"),
        "the image is mirrored in y": (np.flipud, f"{high - 1} - y for y"),
        HALF_TURN: (
            partial(np.rot90, k=2),
            f"{wide - 1} - x for x and {high - 1} - y for y",
        ),
    }
    if wide == high:
        flips |= {
            "x and y of the image are swapped": (
                partial(np.swapaxes, axis1=0, axis2=1),
                "y for x and x for y",
            ),
            "the image is turned by 90 degrees clockwise": (np.rot90, f"y for x and {wide - 1} - x for y"),
            "the image is turned by 90 degrees counter-clockwise": (
                partial(np.rot90, k=3),
                f"{wide - 1} - y for x and x for y",
            ),
        }
    for what, (move, remedy) in flips.items():
        yield Hypothesis(
            what, f"write {remedy} in CD/events, or turn the scene's camera", partial(_moved, move=move), move
        )


def half_turn(recording: Recording) -> Hypothesis:
    """The image is turned by 180 degrees, which leaves no curl."""
    return next(h for h in images(recording) if h.what == HALF_TURN)


def _moved(world: "World", move: Callable) -> "World":
    """Move all that lies in the image of the recording, pixel by pixel."""
    recording = world.recording
    sensor, events = recording.sensor, recording.events
    width = sensor.width
    new = np.empty(sensor.height * width, np.int64)
    new[move(np.arange(len(new)).reshape(sensor.height, width)).ravel()] = np.arange(len(new))
    place = new[events.y.astype(np.int64) * width + events.x]
    x, y = ((v).astype(events.x.dtype) for v in (place % width, place // width))

    def there(value):
        return np.ascontiguousarray(move(value)) if np.ndim(value) else value

    names = "contrast_threshold_on", "contrast_threshold_off"
    sensor = replace(sensor, **{name: there(getattr(sensor, name)) for name in names})
    hot = None if world.hot is None else there(world.hot)
    recording = replace(recording, events=replace(events, x=x, y=y), sensor=sensor)
    return replace(world, recording=recording, hot=hot)


# ---------------------------------------------------------------------- ring


def faults(suspects: list[int]) -> Iterator[Hypothesis]:
    """One LED is dead, or two shine in each other's slots."""
    for j in suspects:
        yield Hypothesis(
            f"LED {j} gives no light",
            "check the ring",
            _order(lambda o, j=j: np.where(o == j, -1, o)),
            leds=(j,),
        )
    for i, j in combinations(suspects, 2):
        yield Hypothesis(
            f"LEDs {i} and {j} are swapped",
            "check the ring and schedule/order",
            _order(lambda o, i=i, j=j: np.select([o == i, o == j], [j, i], o)),
            leds=(i, j),
        )


def orders(order: np.ndarray, n_led: int) -> Iterator[Hypothesis]:
    """All LEDs shine in another order: it is reversed, or starts elsewhere, in time or around the ring."""
    order = np.asarray(order)
    seen = {tuple(order)}
    back = np.where(order < 0, order, n_led - 1 - order)
    for first, how in ((order, ""), (order[::-1], "reversed"), (back, "reversed")):
        for k in range(max(len(order), n_led)):
            shifted = np.where(first < 0, first, (first + k) % n_led)
            for new in (np.roll(first, -k), shifted):
                if tuple(new) not in seen and (seen.add(tuple(new)) or True):
                    yield _reordered(order, new, how)


def opposite(order: np.ndarray, n_led: int) -> str:
    """Say how the order is told if each LED's is that of the one across a ring; "" where none lies across."""
    order = np.asarray(order)
    if n_led % 2:
        return ""
    return _reordered(order, np.where(order < 0, order, (order + n_led // 2) % n_led), "").what


def _reordered(order: np.ndarray, new: np.ndarray, how: str) -> Hypothesis:
    """Describe one order."""
    head = ", ".join(map(str, new[:3]))
    how = "reversed" if how else "rolled"
    what = f"the order of the LEDs is {how}: it starts with {head}"
    return Hypothesis(what, f"write schedule/order = {head}, ...", _order(lambda o: new.astype(o.dtype)))


def _order(change: Callable) -> Callable[["World"], "World"]:
    """Give what changes the order."""

    def mend(world):
        schedule = world.recording.schedule
        schedule = replace(schedule, order=change(np.asarray(schedule.order)))
        return replace(world, recording=replace(world.recording, schedule=schedule))

    return mend


# ---------------------------------------------------------------------- times and sensor


def clocks(recording: Recording) -> Iterator[Hypothesis]:
    """Slots are of another length, or times in another unit."""
    schedule = recording.schedule
    for factor in (FACTOR, 1 / FACTOR):
        slot_us = factor * schedule.slot_us
        yield Hypothesis(
            f"slots last {factor:g} times what is told",
            f"write slot_us = {slot_us:g} in schedule",
            mend_schedule(slot_us=slot_us),
        )
    for unit, us in UNITS.items():
        divide = (
            f"divide t of CD/events and EXT_TRIGGER by {1 / us:g}"
            if us < 1
            else f"multiply t of CD/events and EXT_TRIGGER by {us:g}"
        )
        yield Hypothesis(f"times are in {unit}", divide, partial(_in_us, us=us))


def mend_schedule(**values) -> Callable[["World"], "World"]:
    """Give what changes the schedule."""

    def mend(world):
        schedule = replace(world.recording.schedule, **values)
        return replace(world, recording=replace(world.recording, schedule=schedule))

    return mend


def _in_us(world: "World", us: float) -> "World":
    """Tell times in us that were told in a unit of so many."""
    recording = world.recording
    events = replace(recording.events, t=np.round(recording.events.t * us).astype(np.int64))
    schedule = replace(recording.schedule, start_us=recording.schedule.start_us * us)
    starts = np.asarray(recording.round_start_us) * us
    recording = replace(recording, events=events, schedule=schedule, round_start_us=starts)
    return replace(world, recording=recording, hot=None)  # with other times it was for nothing


def polarities() -> Iterator[Hypothesis]:
    """ON stands for OFF."""
    yield Hypothesis("polarities are flipped", "write 1 - p for p in CD/events", _flipped)


def thresholds(world: "World") -> Iterator[Hypothesis]:
    """Those that are taken as told are others."""
    if not world.thresholds:
        yield Hypothesis(
            "contrast thresholds are not as told",
            "use --thresholds estimate, or calibrate the thresholds",
            lambda world: replace(world, thresholds=True),
        )


def _flipped(world: "World") -> "World":
    """Swap ON and OFF."""
    events = world.recording.events
    return replace(world, recording=replace(world.recording, events=replace(events, p=1 - events.p)))


# ---------------------------------------------------------------------- constant light


def veils(world: "World") -> Iterator[Hypothesis]:
    """There is constant light where none is told: any will do, as no recording tells how much."""
    if world.ring.constant_light == 0:
        brightest = max(float(e.numpy().max()) for e in world.illumination().irradiance)
        yield Hypothesis(
            "there is constant light though constant_light is 0",
            f"measure it and write it as constant_light in {world.ring.path}",
            partial(_veiled, veil=VEIL * brightest),
        )


def too_bright(world: "World") -> Hypothesis:
    """Reflectances are above what a surface can have: it is the constant light that makes them absolute."""
    veil = world.ring.constant_light / FACTOR
    return Hypothesis(
        "constant_light is 10 times too large",
        f"measure it and write it as constant_light in {world.ring.path}, perhaps {veil:g}",
        partial(_veiled, veil=veil),
    )


def _veiled(world: "World", veil: float) -> "World":
    """Believe in another constant light."""
    return replace(world, veil=veil)
