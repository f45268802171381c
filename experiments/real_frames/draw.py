"""Draw an object, its normals, and where each method errs."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from evsdr import angular_error_deg

from .compute import Result
from .objects import Frames

LARGEST_ERROR = 10.0  # of the colour scale [deg]


def draw(frames: Frames, results: list[Result], file: Path) -> None:
    """Draw a frame and normals over error maps.

    Parameters
    ----------
    results : list of Result, (4)
        Each gets an error map; the first and the last show their normals, too.
    file : Path
        The picture to write.
    """
    figure, axes = plt.subplots(2, len(results), figsize=(11, 5.7), layout="constrained")
    outside = ~frames.mask[..., None]
    frame = np.clip(frames.signal[frames.ring[0]] / 0.6, 0, 1) ** (1 / 2.2)
    axes[0, 0].imshow(np.where(frames.mask, frame, 1), cmap="gray", vmin=0, vmax=1)
    axes[0, 0].set_title("one of the frames")
    for axis, title, normal in (
        (axes[0, 1], "true normals", frames.normal),
        (axes[0, 2], results[0].method, results[0].normal),
        (axes[0, 3], results[-1].method, results[-1].normal),
    ):
        axis.imshow(np.where(outside, 1, 0.5 * (normal + 1)))
        axis.set_title(title)
    for axis, result in zip(axes[1], results):
        error = angular_error_deg(result.normal, frames.normal)
        image = axis.imshow(np.where(frames.mask, error, np.nan), vmin=0, vmax=LARGEST_ERROR, cmap="magma")
        error = error[frames.mask]
        axis.set_title(f"{result.method}\nmean {error.mean():.2f}°, median {np.median(error):.2f}°")
    figure.colorbar(image, ax=axes[1], shrink=0.8, extend="max", label="angular error [deg]")
    for axis in axes.ravel():
        axis.title.set_fontsize(9)
        axis.axis("off")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)
    plt.close(figure)
