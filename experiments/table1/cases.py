"""The objects of the benchmark: what each looks like, and how it is recorded."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from evsdr.scenes.formats import Mesh

REPOSITORY = Path(__file__).resolve().parents[2]
BASES = (1, 3, 8)
N_BLOB = 10
MESHES = (
    "nefertiti-lowres.obj",
    "skull_low_resolution.obj",
    "goathead.obj",
    "lionstatue.obj",
    "demosthenes-low-res.obj",
)
POSES_DEG = (-25.0, 35.0)  # turned about the vertical
HALF_WIDTH = 1.15  # of what the camera sees
FIT_TO = 1.05  # half width of an object
BAND_NM = np.array([405, 430, 460, 490, 525, 560, 595, 635])
N_LED, N_WAVE = 24, 40  # LEDs; waves that displace a blob
N_STATE, REPEATS = 96, 3  # of a circle behind a rainbow filter; how often each colour comes on either ring
WIDEST_LOBE = 0.24  # alpha of the paper's widest highlight, of shininess 32: sqrt(2 / (32 + 2))
THRESHOLD, REFRACTORY_US, ROUNDS = 0.10, 300.0, 6


@dataclass(frozen=True)
class Case:
    """One recording to make.

    Attributes
    ----------
    dataset : str
        `blobs` or `sculptures`.
    number : int
        Of the object within it.
    bases : int
        Spectral bases of its texture.
    polar_deg : float
        Angle between the ring's LEDs and the camera's axis [deg].
    texels : int
        Width of the texture.
    noise : float
        Relative standard deviation of the thresholds from one event to the next.
    told : float
        Threshold that the recording tells, relative to the true one.
    seconds : float
        Length of the recording.
    gloss, roughness : float
        Weight of the glossy lobe, and alpha of its Trowbridge-Reitz distribution.
    n_led : int
        LEDs of the ring: N_LED of the paper's bands, or N_STATE places of a continuous circle behind a rainbow filter.
    """

    dataset: str
    number: int
    bases: int
    polar_deg: float
    texels: int
    noise: float
    told: float
    seconds: float
    gloss: float
    roughness: float
    n_led: int = N_LED

    @property
    def name(self) -> str:
        """Name its folder."""
        return f"{self.dataset}_{self.number:02d}_{self.bases}{'_rainbow' if self.is_rainbow else ''}"

    @property
    def is_rainbow(self) -> bool:
        """Tell whether its ring is not that of the paper's LEDs."""
        return self.n_led != N_LED

    @property
    def band_nm(self) -> np.ndarray:
        """Wavelength of each band [nm]; LED j has band j mod their number."""
        return np.linspace(*BAND_NM[[0, -1]], self.n_led // REPEATS) if self.is_rainbow else BAND_NM

    @property
    def seed(self) -> tuple[int, int]:
        """Seed what the bases have in common: shape, ring, pixel."""
        return ("blobs", "sculptures").index(self.dataset), self.number

    @property
    def slot_us(self) -> float:
        """Length of a slot [us]."""
        return round(1e6 * self.seconds / (ROUNDS * self.n_led))


def draw_case(dataset: str, number: int, bases: int, n_led: int = N_LED) -> Case:
    """Draw what the paper gives as a range."""
    rng = np.random.default_rng([("blobs", "sculptures").index(dataset), number])
    return Case(
        dataset,
        number,
        bases,
        polar_deg=rng.uniform(30, 60),
        texels=int(rng.choice([16, 32, 64])),
        noise=rng.uniform(0.05, 0.35),
        told=rng.uniform(0.8, 1.2),
        seconds=rng.uniform(0.2, 0.4),
        gloss=rng.uniform(0.01, 0.04),
        roughness=rng.uniform(0.10, WIDEST_LOBE),
        n_led=n_led,
    )


def data_folder() -> Path:
    """Say where the meshes should be: in $EVSDR_DATA, else in ../shared/data beside the repository."""
    return Path(os.environ.get("EVSDR_DATA") or REPOSITORY.parent / "shared/data") / "meshes"


def list_cases(n_object: int | None = None, bases: tuple[int, ...] = BASES, n_led: int = N_LED) -> list[Case]:
    """List the recordings: some objects of each dataset, or all; sculptures whose mesh is absent are left out."""
    sculptures = [i for i in range(2 * len(MESHES)) if (data_folder() / MESHES[i % len(MESHES)]).is_file()]
    objects = [("blobs", i) for i in range(N_BLOB)][:n_object]
    objects += [("sculptures", i) for i in sculptures][:n_object]
    return [draw_case(*which, n_basis, n_led) for which in objects for n_basis in bases]


def shape_of(case: Case) -> Mesh:
    """Make the mesh of a case."""
    if case.dataset == "blobs":
        return blob(np.random.default_rng([10, case.number]))
    file = data_folder() / MESHES[case.number % len(MESHES)]
    return sculpture(file, POSES_DEG[case.number // len(MESHES)])


def blob(rng: np.random.Generator) -> Mesh:
    """Make a sphere that smooth noise displaces, 20,480 triangles.

    Its radius in direction d is 1 + sum_i a_i cos(k_i . d + phase_i); longer waves are higher. Normals are analytic.
    """
    wave = rng.standard_normal((N_WAVE, 3))
    number = rng.uniform(2, 8, N_WAVE)
    wave *= (number / np.linalg.norm(wave, axis=1))[:, None]
    phase = rng.uniform(0, 2 * np.pi, N_WAVE)
    height = rng.uniform(0.05, 0.1, N_WAVE) / number**0.8

    sphere = trimesh.creation.icosphere(subdivisions=5)
    d = np.asarray(sphere.vertices) / np.linalg.norm(sphere.vertices, axis=1, keepdims=True)
    angle = d @ wave.T + phase
    radius = 1 + (height * np.cos(angle)).sum(axis=1, keepdims=True)
    gradient = -(height * np.sin(angle)) @ wave
    gradient -= np.sum(gradient * d, axis=1, keepdims=True) * d
    normal = radius * d - gradient
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return fitted_mesh(radius * d, normal, np.asarray(sphere.faces))


def sculpture(file: Path, turn_deg: float) -> Mesh:
    """Read a mesh and turn it about the vertical."""
    mesh = trimesh.load(file, force="mesh", process=True)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(turn_deg), [0, 1, 0]))
    return fitted_mesh(np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals), np.asarray(mesh.faces))


def fitted_mesh(position: np.ndarray, normal: np.ndarray, face: np.ndarray) -> Mesh:
    """Centre a mesh and fit it to the film; the texture is projected along the camera's axis."""
    lowest, highest = position.min(axis=0), position.max(axis=0)
    position = (position - 0.5 * (lowest + highest)) * (2 * FIT_TO / np.max((highest - lowest)[:2]))
    return Mesh(position, normal, 0.5 + 0.5 * position[:, :2] / HALF_WIDTH, face)


def texture(case: Case) -> np.ndarray:
    """Draw the reflectance (texels, texels, band) of rank `bases`: each texel mixes the spectra by itself."""
    rng = np.random.default_rng([20, *case.seed, case.bases])
    spectra = np.stack([smooth_spectrum(rng, case.band_nm) for _ in range(case.bases)])
    weight = rng.dirichlet(np.full(case.bases, 0.7), (case.texels, case.texels))
    shade = rng.uniform(0.4, 1.0, (case.texels, case.texels, 1))
    return shade * weight @ spectra


def smooth_spectrum(rng: np.random.Generator, band_nm: np.ndarray) -> np.ndarray:
    """Draw a reflectance (band), 0.08 to 0.9, that varies over some 60 nm."""
    distance = (band_nm[:, None] - band_nm) / 60.0
    covariance = np.exp(-0.5 * distance**2) + 1e-6 * np.eye(len(band_nm))
    return 0.08 + 0.82 / (1 + np.exp(-2 * np.linalg.cholesky(covariance) @ rng.standard_normal(len(band_nm))))


def led_directions(polar_deg: float, n_led: int = N_LED) -> np.ndarray:
    """Give the unit vectors (n_led, 3) to the LEDs, evenly around."""
    azimuth, polar = 2 * np.pi * np.arange(n_led) / n_led, np.radians(polar_deg)
    flat = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1) * np.sin(polar)
    return np.column_stack([flat, np.full(n_led, np.cos(polar))])
