"""
Gloss
=====

A sphere with a rough dielectric coating. Robust weights can't tell its highlights from the shape; a lobe that is fitted with the
maps can.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import evsdr
from evsdr import scenes

SIZE = 64
folder = Path(scenes.__file__).parent
scene = evsdr.load_scene(folder / "glossy_sphere.xml", size=SIZE)
pixel = evsdr.EventPixel(event_noise=0.1).idealised()
recording, truth = evsdr.simulate(scene, pixel, rounds=6, seed=0)

# %%
# `auto` solves some pixels under nine lobes and under none, and takes a lobe if it explains events that it was not fitted to.

fits = {
    name: evsdr.fit(scene, recording, evsdr.Settings(gloss=gloss))
    for name, gloss in (("robust weights only", "off"), ("lobe found", "auto"))
}
for name, found in fits.items():
    print(f"{name}: {found.decisions['gloss'].why}")

# %%
# Without a lobe normals lean toward the highlights, and reflectance makes up for it.

figure, axes = plt.subplots(2, 2, figsize=(7.5, 6), layout="constrained")
for (above, below), (name, found) in zip(axes.T, fits.items()):
    error = evsdr.angular_error_deg(found.maps.normal, truth.normal)
    wrong = (found.maps.reflectance - truth.reflectance).mean(axis=-1)
    angle = above.imshow(np.where(truth.mask, error, np.nan), vmin=0, vmax=8)
    bright = below.imshow(np.where(truth.mask, wrong, np.nan), vmin=-0.1, vmax=0.1, cmap="RdBu_r")
    above.set_title(f"{name}: {error[truth.mask].mean():.2f}°")
    below.set_title("reflectance, difference to the truth")
    above.axis("off"), below.axis("off")
figure.colorbar(angle, ax=axes[0], label="deg")
figure.colorbar(bright, ax=axes[1])
plt.show()
