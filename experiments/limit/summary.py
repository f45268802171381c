"""What the figures of all cases say: ratios against the bound, and the best constant light."""

import numpy as np

SLACK = 1.1  # error, relative to the least, up to which a constant light is as good as the best


def median_ratios(base: list[dict]) -> list[dict]:
    """Give the median over scenes of error / limit in the base case, for each sensor and preset, with and without priors.

    Parameters
    ----------
    base : list of dict
        Rows of `compute.run`.
    """
    out = []
    for key in dict.fromkeys((row["sensor"], row["preset"], row["priors"]) for row in base):
        some = [row for row in base if (row["sensor"], row["preset"], row["priors"]) == key]
        medians = {
            name: float(np.median([row[name] for row in some if row[name] is not None]))
            for name in ("angle_ratio", "angle_typical", "reflectance_ratio", "reflectance_typical")
        }
        out.append(dict(zip(("sensor", "preset", "priors"), key)) | {"scenes": len(some)} | medians)
    return out


def best(values, errors) -> tuple[float, float, float]:
    """Find the least error over a parameter, on logarithmic axes.

    Parameters
    ----------
    values, errors : (n,) float
        Above 0; values rise.

    Returns
    -------
    place : float
        Vertex of the parabola through the least error and its two neighbours; the end of the range if it is there.
    low, high : float
        Range around it within which the error, between the values a straight line, stays below SLACK times the
        least of `errors`.
    """
    x, y = np.log(np.asarray(values, float)), np.log(np.asarray(errors, float))
    i = int(np.argmin(y))
    place = x[i]
    if 0 < i < len(x) - 1:
        a, b, _ = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
        place += -b / (2 * a) if a > 0 else 0.0
    fine = np.linspace(x[0], x[-1], 2001)
    good = np.interp(fine, x, y) <= y[i] + np.log(SLACK)
    start = int(np.argmin(np.abs(fine - x[i])))
    low = start - int(np.argmin(np.append(good[start::-1], False))) + 1
    high = start + int(np.argmin(np.append(good[start:], False))) - 1
    return tuple(float(np.exp(v)) for v in (place, fine[min(low, start)], fine[max(high, start)]))


def best_constant_light(rows: list[dict], signal: dict[str, float]) -> list[dict]:
    """Find the best constant light of each scene, for normals and for reflectance.

    By the errors over all pixels of the truth: among the pixels that the limit calls known, strong constant light
    leaves only the bright ones.

    Parameters
    ----------
    rows : list of dict
        Rows of `compute.run` with `parameter` and `value`.
    signal : dict
        Median LED signal of each scene.

    Returns
    -------
    list of dict
        `scene`, `priors`, `what`, and `best`, `low`, `high` in units of C_w, `relative` to the LED signal.
    """
    rows = [row for row in rows if row["parameter"] == "constant light"]
    out = []
    for name, priors in dict.fromkeys((row["scene"], row["priors"]) for row in rows):
        some = [row for row in rows if (row["scene"], row["priors"]) == (name, priors)]
        for what, key in (("normals", "mae_deg"), ("reflectance", "rmse")):
            place, low, high = best([row["value"] for row in some], [row[key] for row in some])
            found = {"best": place, "low": low, "high": high, "relative": place / signal[name]}
            out.append({"scene": name, "priors": priors, "what": what} | found)
    return out
