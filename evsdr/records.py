"""The frozen records that flow through evsdr: events, sensor, schedule, recording, maps."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Events:
    """Events in time order.

    Attributes
    ----------
    x, y : (n_event,) uint16
        Column and row; row 0 is the top.
    p : (n_event,) int8
        Polarity, 1 (brighter) or 0 (darker).
    t : (n_event,) int64
        Time [us].
    """

    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    t: np.ndarray

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True)
class Sensor:
    """The event pixels of a sensor region.

    Attributes
    ----------
    width, height : int
        Size [pixels].
    contrast_threshold_on, contrast_threshold_off : float or (height, width) float32
        Change of natural log intensity that fires an event.
    refractory_us : float
        Time after an event until the reference intensity is memorised anew [us].
    guessed : tuple of str
        Which of these the file does not tell.
    contrast_threshold_tolerance : float
        Relative standard deviation of thresholds that were measured pixel by pixel; 0 for those that are exact.
    """

    width: int
    height: int
    contrast_threshold_on: float | np.ndarray
    contrast_threshold_off: float | np.ndarray
    refractory_us: float
    guessed: tuple[str, ...] = ()
    contrast_threshold_tolerance: float = 0.0


@dataclass(frozen=True)
class Schedule:
    """Which LED is lit when.

    Attributes
    ----------
    order : (n_slot,) int32
        LED of each slot of a round, -1 for none; after its last slot it starts over.
    slot_us : float
        Length of a slot [us].
    crossfade : float
        Fraction of a slot's end over which LED order[k] fades linearly into order[k+1], 0..1.
    start_us : float
        Start of the first round [us] where no trigger says so.
    trim : (n_led,) float32, optional
        Brightness of each LED relative to what the scene says, 0..1; 1 where it is None.
    constant_light_on : bool, optional
        Whether the constant light was on; None where nobody tells.
    """

    order: np.ndarray
    slot_us: float
    crossfade: float
    start_us: float = 0.0
    trim: np.ndarray | None = None
    constant_light_on: bool | None = None


@dataclass(frozen=True)
class Recording:
    """All that an events.h5 holds.

    Attributes
    ----------
    round_start_us : (n,) int64
        Times of the round-start triggers [us], one per round and one at the end of the last;
        empty where the file has none.
    source : str
        Where it comes from, for sentences.
    """

    events: Events
    sensor: Sensor
    schedule: Schedule
    round_start_us: np.ndarray
    source: str = "the recording"


@dataclass(frozen=True)
class Maps:
    """What is recovered, per pixel; also what is true, for simulated scenes.

    Attributes
    ----------
    normal : (H, W, 3) float32
        Unit normals in the camera frame: x right, y up, z toward the camera.
    reflectance : (H, W, n_band) float32
        Absolute reflectance per band.
    mask : (H, W) bool
        Pixels whose values rest on information.
    normal_sigma_deg : (H, W) float32
        One standard deviation of the normal's angle [deg]; 180 where nothing is known.
    reflectance_sigma : (H, W, n_band) float32
        One standard deviation; 1 where nothing is known.
    band_wavelength_nm : (n_band,) float32
        Centroid of each band [nm].
    mask_reflectance : (H, W) bool
        Pixels whose scale, what all bands have in common, rests on information; as `mask` by default.
    """

    normal: np.ndarray
    reflectance: np.ndarray
    mask: np.ndarray
    normal_sigma_deg: np.ndarray
    reflectance_sigma: np.ndarray
    band_wavelength_nm: np.ndarray
    mask_reflectance: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.mask_reflectance is None:
            object.__setattr__(self, "mask_reflectance", self.mask)


@dataclass(frozen=True)
class Truth:
    """What is true of a scene.

    Attributes
    ----------
    normal : (H, W, 3) float
        Unit normals in the camera frame: x right, y up, z toward the camera.
    reflectance : (H, W, n_band) float
        Absolute reflectance per band.
    mask : (H, W) bool
        Pixels that count.
    """

    normal: np.ndarray
    reflectance: np.ndarray
    mask: np.ndarray


@dataclass(frozen=True)
class Signals:
    """The light of each LED in some pixels, constant light included: as the maps have it, and as events tell it.

    Attributes
    ----------
    pixel : (n,) int
        Where they lie in the image, row-major.
    modelled : (n, n_led) float32
        A_xj + C_w.
    change : (n, n_led) float32
        What is added to its logarithm so that it explains the events of the pixel best, each LED by itself.
        Events only tell ratios of light: the mean over LEDs and darkness is 0.
    sigma : (n, n_led) float32
        One standard deviation of that; 1 or nearly so where no events tell.
    residual : (n,) float32
        What the maps leave unexplained of an event, relative to its threshold: root mean square, by robust weights; 0
        without events.
    count : (n,) int
        Pairs of events.
    band : (n_led,) int
        Band of each LED.
    direction : (n_led, 3) float
        Unit vector to each LED, camera frame, mean over pixels.
    constant_light : float
        C_w.
    """

    pixel: np.ndarray
    modelled: np.ndarray
    change: np.ndarray
    sigma: np.ndarray
    residual: np.ndarray
    count: np.ndarray
    band: np.ndarray
    direction: np.ndarray
    constant_light: float
