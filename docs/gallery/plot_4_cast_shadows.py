"""
Cast shadows
============

A thin pole in front of a sphere: each LED draws one stripe of shadow. Left out, down-weighted as published, found in the events
while the scene file knows nothing of the pole, and traced.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import evsdr
from evsdr import scenes

SIZE = 64
folder = Path(scenes.__file__).parent
scene = evsdr.load_scene(folder / "sphere_pole.xml", size=SIZE)
alone = evsdr.load_scene(folder / "sphere.xml", size=SIZE)
pixel = evsdr.EventPixel(event_noise=0.1).idealised()
recording, truth = evsdr.simulate(scene, pixel, rounds=6, seed=0)

# %%
# `alone` is a scene file in which somebody forgot the pole; the mask leaves out where the pole stands itself.

ways = {
    "left out": (scene, "off"),
    "down-weighted": (scene, "downweight"),
    "pole forgotten, auto": (alone, "auto"),
    "traced": (scene, "scene"),
}
fits = {}
for name, (told, shadows) in ways.items():
    fits[name] = evsdr.fit(told, recording, evsdr.Settings(shadows=shadows, gloss="off"), mask=truth.mask)
    print(
        f"{name}: {evsdr.score(fits[name].maps, truth)['mae_deg']:.2f} deg; {fits[name].decisions['cast shadows'].why}"
    )

# %%
# Errors of the normals [deg]. What the scene file tells costs little; what it lacks, the events tell in part.

figure, axes = plt.subplots(1, len(fits), figsize=(11, 3), layout="constrained")
for axis, (name, found) in zip(axes, fits.items()):
    error = evsdr.angular_error_deg(found.maps.normal, truth.normal)
    shown = axis.imshow(np.where(truth.mask, error, np.nan), vmin=0, vmax=6)
    axis.set_title(f"{name}: {error[truth.mask].mean():.2f}°")
    axis.axis("off")
figure.colorbar(shown, ax=axes)
plt.show()
