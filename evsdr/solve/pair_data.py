"""Event pairs as Dr.Jit arrays: how they are packed, chosen and looked up."""

import sys
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import owned

OF_PIXEL = "first", "last", "threshold_on", "threshold_off", "silent_first", "silent_last"
AT_ONCE = 32  # LEDs in a kernel that fills a table: of more, one kernel takes minutes to compile
LISTS, SILENT_LISTS = (
    ("phases", "bias", "answer", "weight"),
    ("silent_phases", "silent_probes", "silent_bias"),
)


@dataclass(frozen=True)
class PairData:
    """Event pairs of the pixels to solve, as Dr.Jit arrays.

    Attributes
    ----------
    first, last : UInt32, (n_pixel)
        Pairs of pixel i are first[i] .. last[i]; the lists may hold others, too.
    phases : Float, (n_pair * 2)
        For each pair the phase of the ring (slot + crossfade fraction) at its start, and 1 + that at its
        end, with the sign of its polarity.
    threshold_on, threshold_off : Float, (n_pixel)
        Contrast thresholds.
    slot_leds : UInt32, (n_slot + 1)
        LED of each slot, plus 65536 times that of the next; LED n_led is darkness. The first slot stands
        again at the end, for phases that round up.
    silent_first, silent_last : UInt32, (n_pixel), optional
        Silences of pixel i are silent_first[i] .. silent_last[i].
    silent_phases : Float, (n_silence * 2), optional
        For each silence as `phases`; the second is 0 where no event ends it.
    silent_bias : Float, (n_silence), optional
        As `bias`.
    silent_probes : UInt32, (n_silence * 2), optional
        For each silence its first probe, and 1 + its last.
    probes : Float, (n_probe), optional
        Phases that pass in silence.
    bias : Float, (n_pair), optional
        What is added to the change of log I; 0 by default.
    answer : Float, (n_pair * 2), optional
        For each pair by how much log I counts at its start and end; 1 by default.
    weight : Float, (n_pair), optional
        How much a pair counts; 1 by default.
    """

    first: object
    last: object
    phases: object
    threshold_on: object
    threshold_off: object
    slot_leds: object
    silent_first: object = None
    silent_last: object = None
    silent_phases: object = None
    silent_probes: object = None
    silent_bias: object = None
    probes: object = None
    bias: object = None
    answer: object = None
    weight: object = None

    @property
    def counts(self) -> np.ndarray:
        """Number of pairs of each pixel (n_pixel) int64."""
        return self.last.numpy().astype(np.int64) - self.first.numpy()

    def having(self, names: tuple[str, ...]) -> dict:
        """Give those of some lists that there are, by name."""
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def at(self, pixel) -> "PairData":
        """Look at some pixels, UInt32 (n), which may come more than once."""
        return replace(self, **{k: dr.gather(type(v), v, pixel) for k, v in self.having(OF_PIXEL).items()})

    @property
    def events(self) -> "PairData":
        """Give it without silences."""
        return replace(self, silent_first=None, silent_last=None, **dict.fromkeys(SILENT_LISTS))


def bounds(offset: np.ndarray, UInt32: type) -> tuple:
    """Give first and last of lists that begin where those before them end, offset (n + 1)."""
    return owned(UInt32, offset[:-1]), owned(UInt32, offset[1:])


def without(pairs: PairData, ignored: np.ndarray) -> PairData:
    """Leave out all events and silences of some pixels, ignored (n_pixel) bool."""
    left = owned(type(pairs.first), ignored) > 0
    pairs = replace(pairs, last=dr.select(left, pairs.first, pairs.last))
    if pairs.silent_first is None:
        return pairs
    return replace(pairs, silent_last=dr.select(left, pairs.silent_first, pairs.silent_last))


def only(pairs: PairData, told: np.ndarray) -> PairData:
    """Leave out the other events, but not where silences end: told (n_pair) bool, in the order of `every_pair`."""
    pixel = np.repeat(np.arange(len(pairs.counts)), pairs.counts)
    some = np.unique(pixel[~told])
    if len(some) == 0:
        return pairs
    k, of_pixel = _listed(pairs.first, pairs.last, some)
    here = told[np.isin(pixel, some)]
    first, last, lists = _moved(pairs.first, pairs.last, pairs.having(LISTS), some, k[here], of_pixel[here])
    return replace(pairs, first=first, last=last, **lists)


def unlit_by(pairs: PairData, doubtful: np.ndarray) -> PairData:
    """Leave out the events and silences in which certain LEDs give light, doubtful (n_led, n_pixel) bool."""
    some = np.flatnonzero(doubtful.any(axis=0))
    if len(some) == 0:
        return pairs
    table = np.append(doubtful.T, np.zeros((doubtful.shape[1], 1), bool), axis=1)  # darkness last
    slot_leds = pairs.slot_leds.numpy()

    def lit(phase: np.ndarray, pixel: np.ndarray) -> np.ndarray:
        slot = phase.astype(np.int64)
        return table[pixel, slot_leds[slot] & 0xFFFF] | (table[pixel, slot_leds[slot] >> 16] & (phase > slot))

    def lit_at_ends(phases, k: np.ndarray, pixel: np.ndarray) -> np.ndarray:
        start, coded = _rows(phases, k)
        return lit(start, pixel) | (lit(np.maximum(np.abs(coded) - 1, 0), pixel) & (coded != 0))

    k, pixel = _listed(pairs.first, pairs.last, some)
    told = ~lit_at_ends(pairs.phases, k, pixel)
    first, last, lists = _moved(pairs.first, pairs.last, pairs.having(LISTS), some, k[told], pixel[told])
    kept = replace(pairs, first=first, last=last, **lists)
    if pairs.silent_first is None:
        return kept
    k, pixel = _listed(pairs.silent_first, pairs.silent_last, some)
    begin, end = _rows(pairs.silent_probes, k).astype(np.int64)
    silence = np.repeat(np.arange(len(k)), end - begin)
    passed = lit(pairs.probes.numpy()[_ranges(begin, end - begin)], pixel[silence])
    told = ~lit_at_ends(pairs.silent_phases, k, pixel) & (np.bincount(silence, passed, len(k)) == 0)
    silent = pairs.silent_first, pairs.silent_last, pairs.having(SILENT_LISTS)
    first, last, lists = _moved(*silent, some, k[told], pixel[told])
    return replace(kept, silent_first=first, silent_last=last, **lists)


def _ranges(begin: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Give begin, begin + 1, .. of each range, one after the other."""
    return np.arange(count.sum()) + np.repeat(begin - (np.cumsum(count) - count), count)


def _rows(twos, k: np.ndarray) -> np.ndarray:
    """Give some rows (2, n) of an array (2 * n_row,), which holds one number where there are none."""
    values = twos.numpy()
    return values.reshape(-1, 2)[k].T if len(k) else np.zeros((2, 0), values.dtype)


def _listed(first, last, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the places in a list of all that some pixels have, and whose they are."""
    begin = first.numpy().astype(np.int64)[some]
    count = last.numpy()[some] - begin
    return _ranges(begin, count), np.repeat(some, count)


def _moved(first, last, lists: dict, some: np.ndarray, k: np.ndarray, pixel: np.ndarray) -> tuple:
    """Let some pixels have the places k only, whose those are: at the end of the lists."""
    n = dr.width(next(iter(lists.values()))) // 2  # phases come in twos
    if n == 0:  # none has any
        return first, last, lists
    longer = {}
    for name, value in lists.items():
        rows = value.numpy().reshape(n, -1)
        longer[name] = owned(type(value), np.concatenate([rows, rows[k]]).ravel())
    begin, end = first.numpy().copy(), last.numpy().copy()
    count = np.bincount(pixel, minlength=len(begin))[some]
    end[some] = n + np.cumsum(count)
    begin[some] = end[some] - count
    return owned(type(first), begin), owned(type(first), end), longer


def thin(pairs: PairData, most: int) -> PairData:
    """Keep at most so many events and silences of each pixel, spread evenly over the recording, and nothing else."""
    first, last, lists = _thinned(pairs.first, pairs.last, pairs.having(LISTS), most)
    pairs = replace(pairs, first=first, last=last, **lists)
    if pairs.silent_first is None:
        return pairs
    first, last, lists = _thinned(pairs.silent_first, pairs.silent_last, pairs.having(SILENT_LISTS), most)
    return replace(pairs, silent_first=first, silent_last=last, **lists)


def _thinned(first, last, lists: dict, most: int) -> tuple:
    begin = first.numpy().astype(np.int64)
    count = last.numpy() - begin
    some = np.minimum(count, most)
    new = np.concatenate([[0], np.cumsum(some)])
    within = np.arange(new[-1]) - np.repeat(new[:-1], some)
    k = np.repeat(begin, some) + within * np.repeat(count, some) // np.maximum(np.repeat(some, some), 1)
    n = max(dr.width(next(iter(lists.values()))) // 2, 1)  # phases come in twos
    chosen = {name: owned(type(v), v.numpy().reshape(n, -1)[k].ravel()) for name, v in lists.items()}
    return *bounds(new, type(first)), chosen


def pack_phases(start: np.ndarray, end: np.ndarray, polarity: np.ndarray) -> np.ndarray:
    """Interleave phases (n_pair) for `PairData`: one look-up fetches all there is to know of a pair."""
    return np.stack([start, polarity * (1 + end)], axis=-1).astype(np.float32).ravel()


def pack_slots(order: np.ndarray, n_led: int) -> np.ndarray:
    """Combine the LED of each slot with that of the next for `PairData`; -1 is darkness."""
    led = np.where(order < 0, n_led, order).astype(np.uint32)
    leds = led + np.uint32(65536) * np.roll(led, -1)
    return np.append(leds, leds[0])


def unpack_pair(phases, k, active):
    """Fetch phase at start, phase at end and polarity of pair k."""
    Float = type(phases)
    start, coded = dr.gather(array_type(Float, 2), phases, k, active)
    return start, dr.abs(coded) - 1.0, dr.sign(coded)


def looked_up(values, k, active):
    """Look an optional list up; 0 where there is none."""
    return 0.0 if values is None else dr.gather(type(values), values, k, active)


def change_of_log(pairs: PairData, start, end, k, active):
    """Give by how much what is shown changes in pair k, from light at start and end, and how it answers to these."""
    bias = looked_up(pairs.bias, k, active)
    if pairs.answer is None:
        return dr.log(end / start) + bias, 1.0, 1.0
    first, last = dr.gather(array_type(type(pairs.answer), 2), pairs.answer, k, active)
    return last * dr.log(end) - first * dr.log(start) + bias, first, last


def array_type(kind: type, size: int) -> type:
    """Give the type of small vectors of a Float or UInt32 type."""
    letter = "f" if dr.is_float_v(kind) else "u"
    return getattr(sys.modules[kind.__module__], f"Array{size}{letter}")


def lit_leds(pairs: PairData, phase, active):
    """Tell which two LEDs are lit at a phase, and their shares."""
    slot = type(pairs.first)(phase)
    fade = phase - type(phase)(slot)
    leds = dr.gather(type(pairs.first), pairs.slot_leds, slot, active)
    return ((leds & 0xFFFF, 1.0 - fade), (leds >> 16, fade))


# ---------------------------------------------------------------------- residuals


@dataclass(frozen=True)
class Table:
    """Values of (pixel, LED) for look-up: pixel after pixel, in each LED after LED, darkness last.

    Attributes
    ----------
    values : Float, (n_pixel * (n_led + 1) * size)
    n_led : int
    size : int
        Values of each.
    """

    values: object
    n_led: int
    size: int

    @classmethod
    def of(cls, rows: list[list], n_pixel: int, room=None) -> "Table":
        """Lay out some values for each LED, of width 1 or n_pixel; darkness has zeros.

        A frozen function must be given `room`, see `room_for`: it would replay the size of an array that it makes itself.
        """
        Float, n, size = type(rows[0][0]), len(rows) + 1, len(rows[0])
        vector = Float if size == 1 else array_type(Float, size)
        place = dr.arange(dr.uint32_array_t(Float), n_pixel) * n
        values = Float(room_for(Float, n_pixel, len(rows), size) if room is None else room)
        for begin in range(0, len(rows), AT_ONCE):
            for j, row in enumerate(rows[begin : begin + AT_ONCE]):
                entry = vector(*(dr.zeros(Float, n_pixel) + value for value in row))
                dr.scatter(values, entry, place + j, mode=dr.ReduceMode.NoConflicts)
            if len(rows) > AT_ONCE:
                place += AT_ONCE
                dr.eval(values, place)
        return cls(values, len(rows), size)

    def at(self, pixel, led, active):
        """Look all values of an entry up."""
        vector = type(self.values) if self.size == 1 else array_type(type(self.values), self.size)
        return dr.gather(vector, self.values, pixel * (self.n_led + 1) + led, active)

    def first_at(self, pixel, led, active):
        """Look the first value of an entry up."""
        place = (pixel * (self.n_led + 1) + led) * self.size
        return dr.gather(type(self.values), self.values, place, active)


def room_for(Float: type, n_pixel: int, n_led: int, size: int = 4):
    """Give the zeros that `Table.of` fills."""
    room = dr.zeros(Float, n_pixel * (n_led + 1) * size)
    dr.make_opaque(room)
    return room


def signal_table(signal: list, n_pixel: int) -> Table:
    """Lay one value per LED out."""
    return Table.of([[row] for row in signal], n_pixel)


def ends(table: Table, pairs: PairData, k, pixel, active):
    """Look up the first values of a table at start and end of pair k, and the pair's polarity."""
    *phases, polarity = unpack_pair(pairs.phases, k, active)
    values = [
        sum(share * table.first_at(pixel, led, active) for led, share in lit_leds(pairs, phase, active))
        for phase in phases
    ]
    return *values, polarity


def every_pair(pairs: PairData):
    """Give the number of every pair, and its pixel."""
    UInt32, count = type(pairs.first), pairs.counts
    pixel = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count
    return owned(UInt32, np.arange(len(pixel)) + (pairs.first.numpy() - before)[pixel]), owned(UInt32, pixel)
