"""A fit of 10 x 10 pixels, and its world, for what is said of them."""

from types import SimpleNamespace

import numpy as np

from evsdr.fitting import verdict
from evsdr.records import Schedule, Sensor

N = 100


def fitted(
    gain=None, noise=0.1, noisy=0, known=N, scaled=N, busy=0, hidden=None, prior=None, reflectance=0.5
):
    """A fit; the first of its pixels are so noisy that they count for nothing, only some, or their scales, are known,
    and the first fire nine times as often; LED 2 is hidden from the first, where that is modelled."""
    factor = np.ones(N)
    factor[:noisy] = 2 * verdict.CONTRARY
    solution = SimpleNamespace(
        noise=noise,
        noise_factor=factor,
        threshold_gain=gain,
        threshold_gain_sigma=None if gain is None else np.full((N, 2), 0.02),
        prior_scale={"rank": 3},
        threshold_prior=prior,
    )
    mask, mask_reflectance = ((np.arange(N) < n).reshape(10, 10) for n in (known, min(known, scaled)))
    reflectance = np.full((10, 10, 3), reflectance)
    maps = SimpleNamespace(mask=mask, mask_reflectance=mask_reflectance, reflectance=reflectance)
    maps.reflectance_sigma = np.full_like(reflectance, 0.2)
    count = np.full(N, 20)
    count[:busy] *= 9
    told = SimpleNamespace(offset=np.append(0, np.cumsum(count)).astype(np.uint32))
    light = SimpleNamespace(irradiance=[np.ones(N)] * 3)
    visible = None if hidden is None else np.ones((3, N))
    if hidden:
        visible[2, :hidden] = 0
    of_pixel = dict(pixel=np.arange(N), n_pixel=N, fired=np.ones(N, bool), visible=visible)
    problem = SimpleNamespace(told=told, illumination=light, **of_pixel)
    return SimpleNamespace(solution=solution, maps=maps, problem=problem)


def world(constant_light=0.05, shape=False, **more):
    """A world that believes what it is told."""
    recording = SimpleNamespace(
        source="b.h5", sensor=Sensor(10, 10, 0.2, 0.3, 50.0), schedule=Schedule(np.array([0, 0, 2]), 1e4, 1.0)
    )
    leds = SimpleNamespace(band=[0, 1, 2], band_wavelength_nm=np.array([450.0, 550.0, 650.0]))
    ring = SimpleNamespace(path="a.xml", constant_light=constant_light, leds=leds, shape_is_known=shape)
    given = dict(ring=ring, recording=recording, hot=None, decisions={}, shadows="none", gloss=None)
    return SimpleNamespace(**given | more)
