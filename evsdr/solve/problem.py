"""From a recording and a traced scene to the arrays that the solvers work on."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.events.pairs import Pairs
from evsdr.model.arrays import owned, picked
from evsdr.model.gloss import GlossyRing
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.model.metal import MetalRing
from evsdr.model.rough import RoughRing
from evsdr.records import Recording
from evsdr.solve.grid import Grid, make_grid
from evsdr.solve.pair_data import PairData, pack_phases, pack_slots, without

DARK = 1e-6  # floor of the constant light, as a share of the brightest LED: keeps log I finite in shadow


@dataclass(frozen=True)
class Problem:
    """The pixels to solve.

    Attributes
    ----------
    pixel : (n_pixel,) int
        Where they lie in the image, row-major.
    fired : (n_pixel,) bool
        Whether they fired events, hot ones included.
    pairs : PairData
        Their event pairs.
    illumination : Illumination
        What the LEDs send to them; its constant light is above 0.
    grid : Grid
        Their neighbours.
    lobe : BlinnPhong or RoughCoating, optional
        Their gloss.
    metal : Float, optional
        Their roughness, if they are of metal.
    rough : Float, optional
        Roughness of their matt part, see `model.rough`.
    view : Array3f, optional
        Unit vectors from surface to camera, see `GlossyRing`.
    start : (n_pixel, n_unknown) float32, optional
        Unknowns to start from that go with the light, better than those of an earlier fit.
    told : Pairs, optional
        Pairs of all pixels, hot ones included.
    visible : (n_led, n_pixel) float32, optional
        What they see of the LEDs, which `illumination` counts already; all by default.
    """

    pixel: np.ndarray
    fired: np.ndarray
    pairs: PairData
    illumination: Illumination
    grid: Grid
    lobe: object = None
    metal: object = None
    rough: object = None
    view: object = None
    start: np.ndarray | None = None
    told: Pairs | None = None
    visible: np.ndarray | None = None

    @property
    def n_pixel(self) -> int:
        return len(self.pixel)

    def at(self, row: np.ndarray, grid: Grid) -> "Problem":
        """Keep some pixels, which are those of a grid: rows (n,) int, growing."""
        index = owned(type(self.pairs.first), row)
        return replace(
            self,
            pixel=self.pixel[row],
            fired=self.fired[row],
            pairs=self.pairs.at(index),
            illumination=self.illumination.gather(index),
            grid=grid,
            **self._surface_at(index),
            start=None if self.start is None else self.start[row],
            visible=None if self.visible is None else self.visible[:, row],
        )

    @property
    def model(self) -> LambertianRing | RoughRing | GlossyRing | MetalRing:
        """The forward model."""
        if self.metal is not None:
            return MetalRing(self.illumination, self.metal, self.view)
        if self.lobe is not None:
            return GlossyRing(self.illumination, self.lobe, self.view, self.rough)
        if self.rough is not None:
            return RoughRing(self.illumination, self.rough, self.view)
        return LambertianRing(self.illumination)

    def model_at(self, index) -> LambertianRing | RoughRing | GlossyRing | MetalRing:
        """Give the forward model of some pixels, told by a UInt32."""
        return replace(self, illumination=self.illumination.gather(index), **self._surface_at(index)).model

    def _surface_at(self, index) -> dict:
        return {name: picked(getattr(self, name), index) for name in ("lobe", "metal", "rough", "view")}


def make_problem(
    recording: Recording,
    pairs: Pairs,
    light: Illumination,
    mask: np.ndarray,
    hot: np.ndarray | None = None,
) -> Problem:
    """Collect what the solver needs of the masked pixels.

    Parameters
    ----------
    recording : Recording
        For its sensor and schedule.
    pairs : Pairs
        Event pairs of all pixels.
    light : Illumination
        What the LEDs send; arrays of width 1 or height * width.
    mask : (height, width) bool
        Pixels to solve.
    hot : (height, width) bool, optional
        Pixels whose events and silences count for nothing.
    """
    data, pixel = lay_out(recording, pairs, mask, light), np.flatnonzero(mask)
    UInt32 = type(data.first)
    return Problem(
        pixel=pixel,
        fired=np.diff(pairs.offset)[pixel] > 0,
        pairs=data if hot is None else without(data, hot.ravel()[pixel]),
        illumination=_of_pixels(light, owned(UInt32, pixel)),
        grid=make_grid(mask, UInt32),
        told=pairs,
    )


def lay_out(recording: Recording, pairs: Pairs, mask: np.ndarray, light: Illumination) -> PairData:
    """Lay out what the events of the masked pixels tell; arguments as of `make_problem`."""
    Float = type(light.constant_light)
    UInt32, pixel = dr.uint32_array_t(Float), np.flatnonzero(mask)

    def of_pixels(values):
        return np.broadcast_to(values, mask.size)[pixel]

    on, off = (
        np.ravel(np.asarray(value, np.float32))
        for value in (recording.sensor.contrast_threshold_on, recording.sensor.contrast_threshold_off)
    )
    probes = np.stack([pairs.probe_offset[:-1], pairs.probe_offset[1:]], axis=-1)
    silent = pairs.silent_start, pairs.silent_end, pairs.silent_polarity
    return PairData(
        first=owned(UInt32, of_pixels(pairs.offset[:-1])),
        last=owned(UInt32, of_pixels(pairs.offset[1:])),
        phases=owned(Float, pack_phases(pairs.phase_start, pairs.phase_end, pairs.polarity)),
        threshold_on=owned(Float, of_pixels(on)),
        threshold_off=owned(Float, of_pixels(off)),
        slot_leds=owned(UInt32, pack_slots(recording.schedule.order, light.n_led)),
        silent_first=owned(UInt32, of_pixels(pairs.silent_offset[:-1])),
        silent_last=owned(UInt32, of_pixels(pairs.silent_offset[1:])),
        silent_phases=owned(Float, pack_phases(*silent)),
        silent_probes=owned(UInt32, probes.ravel()),
        silent_bias=owned(Float, pairs.silent_bias),
        probes=owned(Float, pairs.silent_probe),
        bias=owned(Float, pairs.bias),
        answer=None if pairs.answer is None else owned(Float, pairs.answer.ravel()),
    )


def _of_pixels(light: Illumination, pixel) -> Illumination:
    """Keep the light of some pixels, UInt32 (n), with a constant light above 0."""
    brightest = max(float(dr.max(e)[0]) for e in light.irradiance)
    constant_light = dr.opaque(
        type(light.constant_light), max(float(light.constant_light[0]), DARK * brightest)
    )
    return replace(light.gather(pixel), constant_light=constant_light)
