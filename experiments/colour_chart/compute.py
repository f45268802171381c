"""A colour chart with and without dark slots: what each of its patches gives."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

import evsdr
from evsdr import EventPixel, Maps, Schedule, Settings, Truth, angular_error_deg

REPOSITORY = Path(__file__).resolve().parents[2]
SCENE = REPOSITORY / "scenes" / "colorchecker.xml"
N_LED, PAUSE = 24, 3  # of the ring; LEDs between two dark slots
SLOT_US = 20_000.0
NOISE = 0.1  # of each threshold, from event to event
N_ROW, N_COLUMN = 4, 6
SAME = 1e-4  # difference of true reflectances within one patch


@dataclass(frozen=True)
class Chart:
    """What a fit gives of the chart.

    Attributes
    ----------
    maps : Maps
    truth : Truth
    n_event : (height, width) int
        Events of each pixel.
    error : dict
        Metrics over all of the truth's pixels.
    """

    maps: Maps
    truth: Truth
    n_event: np.ndarray
    error: dict


def order_with_pauses(n_led: int) -> tuple[int, ...]:
    """Give the LEDs in turn, with a dark slot (-1) before every PAUSE of them."""
    return tuple(slot for j in range(n_led) for slot in ((-1, j) if j % PAUSE == 0 else (j,)))


def fit_chart(order: tuple[int, ...] | None, size: int, thresholds: str = "auto") -> Chart:
    """Simulate a recording of the chart and fit it.

    As `python -m evsdr.simulate scenes/colorchecker.xml --ideal --pixel.event-noise 0.1 [--order ...]` and
    `python -m evsdr.fit scenes/colorchecker.xml [--thresholds ...]` do.

    Parameters
    ----------
    order : tuple of int, optional
        LED of each slot, -1 for none; by default each in turn.
    size : int
        Width and height [pixels].
    thresholds : str
        `thresholds` of the fit's settings.
    """
    scene = evsdr.load_scene(SCENE, size=size)
    schedule = Schedule(np.array(order or range(N_LED), np.int32), SLOT_US, 1.0)
    recording, truth = evsdr.simulate(scene, EventPixel(event_noise=NOISE).idealised(), schedule)
    maps = evsdr.fit(scene, recording, Settings(thresholds=thresholds)).maps
    events = recording.events
    n_event = np.bincount(events.y.astype(int) * size + events.x, minlength=size * size).reshape(size, size)
    return Chart(maps, truth, n_event, evsdr.score(maps, truth))


def find_patches(truth: Truth) -> np.ndarray:
    """Tell which patch each pixel shows whole.

    A patch is a region of one reflectance; pixels beside another reflectance are left out.

    Returns
    -------
    (height, width) int
        Patch 0 .. 23, row by row from the top left; -1 elsewhere.

    Raises
    ------
    ValueError
        The image is too small to tell 24 patches.
    """
    inside = truth.mask.copy()
    for axis in (0, 1):
        for step in (1, -1):
            beside = np.roll(truth.reflectance, step, axis)
            inside &= (np.abs(truth.reflectance - beside) < SAME).all(axis=-1) & np.roll(
                truth.mask, step, axis
            )
    label, n = ndimage.label(inside)
    number = np.arange(1, n + 1)
    area = ndimage.sum_labels(inside, label, number)
    number = number[area > area.max(initial=0) / 2]
    if len(number) != N_ROW * N_COLUMN:
        raise ValueError(f"{len(number)} patches instead of {N_ROW * N_COLUMN}; make the image larger.")
    y, x = np.transpose(ndimage.center_of_mass(inside, label, number))
    by_height = np.argsort(y).reshape(N_ROW, N_COLUMN)
    by_place = np.concatenate([row[np.argsort(x[row])] for row in by_height])
    patch = np.full(inside.shape, -1)
    for i, k in enumerate(by_place):
        patch[label == number[k]] = i
    return patch


def patch_errors(chart: Chart, patch: np.ndarray) -> list[dict]:
    """Compare each patch with the truth, absolute, without rescaling.

    Parameters
    ----------
    patch : (height, width) int
        Of `find_patches`.

    Returns
    -------
    list of dict, (24)
        `events` per pixel; `known`, share of pixels that the fit knows; `rmse_of_mean`: root mean square over bands
        of the error of the patch's mean reflectance; `rmse`: mean over pixels of the root mean square over bands;
        `sam_deg`: mean spectral angle [deg]; `angle_deg`: mean angle between normals [deg].
    """
    out = []
    for i in range(patch.max() + 1):
        here = patch == i
        found, true = (np.asarray(m.reflectance[here], float) for m in (chart.maps, chart.truth))
        out.append(
            {
                "events": float(chart.n_event[here].mean()),
                "known": float(chart.maps.mask[here].mean()),
                "rmse_of_mean": float(np.sqrt(np.mean((found.mean(axis=0) - true.mean(axis=0)) ** 2))),
                "rmse": float(np.sqrt(np.mean((found - true) ** 2, axis=-1)).mean()),
                "sam_deg": float(angular_error_deg(found, true).mean()),
                "angle_deg": float(
                    angular_error_deg(chart.maps.normal[here], chart.truth.normal[here]).mean()
                ),
            }
        )
    return out
