"""A photoreceptor in small steps of its equation, tau / (I + I_dark) dv/dt = log I - v."""

import numpy as np

N_SLOT, N_STEP = 7, 10_500  # steps per round, 1500 per slot
TAU = 0.01  # slots: slower than an EVK4 in slots of 20 ms
CROSSFADES = (1.0, 0.3, 0.0)


def light_of(position, light, crossfade):
    """Give I at slot + fraction, by the schedule's own words."""
    slot = int(position) % N_SLOT
    fade = max(position - int(position) - (1 - crossfade), 0) / crossfade if crossfade else 0
    return (1 - fade) * light[slot] + fade * light[(slot + 1) % N_SLOT]


def stepped(light, tau, dark, crossfade):
    """Give positions, log I and v (N_STEP) after each step of the third round."""
    dt = N_SLOT / N_STEP
    v, out = np.log(light[0]), []
    for k in range(3 * N_STEP):
        now = light_of((k + 0.5) * dt, light, crossfade)
        v = np.log(now) + (v - np.log(now)) * np.exp(-dt * (now + dark) / tau)
        out.append(v)
    position = np.arange(1, N_STEP + 1) * dt
    log_now = np.log([light_of(p, light, crossfade) for p in position])
    return position, log_now, np.array(out[2 * N_STEP :])
