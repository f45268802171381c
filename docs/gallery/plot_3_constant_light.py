"""
How much constant light
=======================

The constant light makes reflectance absolute: without it events tell ratios only. Too much of it drowns the LEDs.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import evsdr
from evsdr import scenes

SIZE = 64
folder = Path(scenes.__file__).parent
pixel = evsdr.EventPixel(event_noise=0.1).idealised()
settings = evsdr.Settings(preset="fast", priors=())
constant_lights = (0.005, 0.02, 0.05, 0.1, 0.4)

# %%
# A matt surface of this scene gives about 0.1 per lit LED. Each pixel is fitted alone: priors would help where events don't.

scores, events = [], []
for constant_light in constant_lights:
    scene = evsdr.load_scene(folder / "sphere.xml", size=SIZE, constant_light=constant_light)
    recording, truth = evsdr.simulate(scene, pixel, rounds=6, seed=0)
    found = evsdr.fit(scene, recording, settings)
    score = evsdr.score(found.maps, truth)
    scores.append(score)
    events.append(len(recording.events) / truth.mask.sum())
    print(f"C_w {constant_light}: {score['mae_deg']:.2f} deg, RMSE {score['rmse']:.4f}")

# %%
# Less constant light gives more events and better normals. But the scale rests on signals about as weak as C_w, and the fewer
# there are of those, the less is known of it: for reflectance half of the LEDs' signal is about best. Dotted: the examples' value.

figure, axes = plt.subplots(1, 3, figsize=(11, 3), layout="constrained")
columns = events, [s["mae_deg"] for s in scores], [s["rmse"] for s in scores]
for axis, values, title in zip(
    axes, columns, ("events per pixel", "mean angle [deg]", "RMSE of reflectance")
):
    axis.loglog(constant_lights, values, "o-")
    axis.axvline(0.05, color="gray", ls=":", lw=1)
    axis.set(title=title, xlabel="constant light C_w")
print(f"best for reflectance: C_w {constant_lights[int(np.argmin(columns[2]))]}")
plt.show()
