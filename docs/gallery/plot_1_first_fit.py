"""
A first fit
===========

Simulate what an EVK4 records of a bumpy mesh, fit it, and see how far off it is and whether it knows.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import evsdr
from evsdr import scenes

SIZE = 64
folder = Path(scenes.__file__).parent
scene = evsdr.load_scene(folder / "blob.xml", size=SIZE)
recording, truth = evsdr.simulate(scene, evsdr.EventPixel(), rounds=6, seed=0)
print(f"{len(recording.events):,} events")

# %%
# The fit decides by itself what has to be modelled. What it decided, and why, is in `decisions`.

found = evsdr.fit(scene, recording)
maps = found.maps
print(found.verdict)
for name in ("cast shadows", "photoreceptor lag", "gloss"):
    print(f"{name}: {found.decisions[name].why}")
print({name: round(value, 4) for name, value in evsdr.score(maps, truth).items()})

# %%
# Normals (green is up), reflectance of one band, and the angle to the truth beside the sigma that the fit gives it.

error = np.where(truth.mask, evsdr.angular_error_deg(maps.normal, truth.normal), np.nan)
sigma = np.where(truth.mask, maps.normal_sigma_deg, np.nan)
band = 4
figure, axes = plt.subplots(1, 4, figsize=(11, 3), layout="constrained")
axes[0].imshow(np.where(truth.mask[..., None], 0.5 + 0.5 * maps.normal, 1))
axes[1].imshow(np.where(truth.mask, maps.reflectance[..., band], np.nan), vmin=0, cmap="gray")
axes[2].imshow(error, vmin=0, vmax=3)
shown = axes[3].imshow(sigma, vmin=0, vmax=3)
titles = "normals", f"reflectance, {maps.band_wavelength_nm[band]:.0f} nm", "error [deg]", "sigma [deg]"
for axis, title in zip(axes, titles):
    axis.set_title(title)
    axis.axis("off")
figure.colorbar(shown, ax=axes[2:])

# %%
# If sigmas are true, z = error / sigma of a normal has the distribution 1 - exp(-z²): 63 % lie within one.

known = maps.mask & truth.mask
z = np.sort(error[known] / sigma[known])
figure, axis = plt.subplots(figsize=(5, 3.2), layout="constrained")
axis.plot(z, np.arange(1, len(z) + 1) / len(z), label="this fit")
grid = np.linspace(0, 4, 200)
axis.plot(grid, 1 - np.exp(-(grid**2)), "--", color="gray", label="true sigmas")
axis.set(xlim=(0, 4), ylim=(0, 1), xlabel="error / sigma", ylabel="share of the pixels")
axis.legend()
plt.show()
