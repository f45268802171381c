"""
The events of one pixel
=======================

What a pixel sees while the ring goes round, when it fires, and what the fit makes of that.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import evsdr
from evsdr import scenes

SIZE = 64
folder = Path(scenes.__file__).parent
scene = evsdr.load_scene(folder / "sphere.xml", size=SIZE)
pixel = evsdr.EventPixel(event_noise=0.05).idealised()
recording, truth = evsdr.simulate(scene, pixel, rounds=3, seed=0)
found = evsdr.fit(scene, recording, evsdr.Settings(preset="fast"))

# %%
# One pixel, right of the middle and a little above it. `signals` holds what the fitted maps say of each LED there, constant
# light included; with `crossfade` 1 the light goes linearly from one LED to the next.

row, column = int(0.42 * SIZE), int(0.68 * SIZE)
events, schedule = recording.events, recording.schedule
mine = (events.x == column) & (events.y == row)
here = np.flatnonzero(found.signals.pixel == row * SIZE + column)[0]
light = found.signals.modelled[here][schedule.order]
start, n_slot = recording.round_start_us[0], len(light)


def log_light(t_us):
    """Give log I of the pixel, as the fit has it."""
    slot = (t_us - start) / schedule.slot_us % n_slot
    return np.log(np.interp(slot, np.arange(n_slot + 1), np.append(light, light[0])))


# %%
# Each event says: since the reference was memorised log I has changed by a threshold. Each band has three LEDs, so the spectrum
# of the surface comes three times a round, now brighter, now darker, as the surface is tilted. Dotted: the constant light.

end = start + n_slot * schedule.slot_us
time = np.linspace(start, end, 2000)
when, brighter = events.t[mine], events.p[mine] == 1
inside = (when >= start) & (when < end)
figure, axis = plt.subplots(figsize=(10, 3.6), layout="constrained")
axis.plot(time / 1e3, log_light(time), color="black", lw=1)
for which, colour, name in ((brighter, "tab:red", "brighter"), (~brighter, "tab:blue", "darker")):
    t = when[inside & which]
    axis.plot(t / 1e3, log_light(t), "o", color=colour, ms=4, label=name)
axis.axhline(np.log(found.signals.constant_light), color="gray", ls=":", lw=1)
axis.set(xlabel="time [ms], one round", ylabel="log I")
axis.legend(loc="lower right")

# %%
# The change of log I between the end of one event's refractory period and the next event, in thresholds: one, but for the
# noise of 5 % that this sensor has.

change = log_light(when[1:]) - log_light(when[:-1] + recording.sensor.refractory_us)
threshold = np.where(
    brighter[1:], recording.sensor.contrast_threshold_on, -recording.sensor.contrast_threshold_off
)
print(
    f"{len(change)} pairs; change / threshold: {np.mean(change / threshold):.3f} +- {np.std(change / threshold):.3f}"
)
angle = evsdr.angular_error_deg(found.maps.normal[row, column], truth.normal[row, column])
print(f"normal {found.maps.normal[row, column].round(3)}, {angle:.2f} degrees off")
plt.show()
