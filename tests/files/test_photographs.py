"""Stacks of photographs: what bad ones say, what good ones become, and that events of them lead back to the shape."""

import numpy as np
import pytest

from evsdr.commands import fit, simulate
from evsdr.errors import InputError
from evsdr.files.photographs import read_stack
from evsdr.metrics import angular_error_deg

N_LED, SIZE = 12, 32
REFLECTANCE = 0.4


def lights():
    """Give an uneven ring, so that a mirrored or shifted one shows."""
    azimuth = 2 * np.pi * (np.arange(N_LED) + 0.3 * np.cos(np.arange(N_LED))) / N_LED
    return np.column_stack([np.cos(azimuth), np.sin(azimuth), np.ones(N_LED)]) / np.sqrt(2)


def sphere():
    """Give photographs of a Lambertian sphere of one reflectance, with what is true of them."""
    y, x = np.mgrid[1 : -1 : SIZE * 1j, -1 : 1 : SIZE * 1j] * 1.05  # row 0 is the top
    z2 = 1 - x**2 - y**2
    mask = z2 > 0.1
    normal = np.stack([x, y, np.sqrt(np.where(mask, z2, 1))], axis=-1)
    normal[~mask] = (0, 0, 1)
    frames = REFLECTANCE * mask * np.maximum(np.einsum("ji,yxi->jyx", lights(), normal), 0)
    return dict(
        frames=frames,
        light_direction=3 * lights(),  # of any length
        normal=normal,
        reflectance=np.full((SIZE, SIZE, 1), REFLECTANCE),
        mask=mask,
    )


@pytest.fixture
def save(tmp_path):
    """Give a function that writes the sphere's stack, with changes; None leaves an array out."""

    def write(**changes):
        arrays = sphere() | changes
        np.savez(tmp_path / "stack.npz", **{name: a for name, a in arrays.items() if a is not None})
        return tmp_path / "stack.npz"

    return write


def put(name, index, value):
    """Give an array of the sphere's stack with one spoilt place."""
    array = sphere()[name]
    array[index] = value
    return {name: array}


MIDDLE = (SIZE // 2, SIZE // 2)
FLAT = np.zeros((SIZE, SIZE))


@pytest.mark.parametrize(
    "changes, sentence",
    [
        (dict(frames=None), "frames is missing"),
        (dict(light_direction=None), "light_direction is missing"),
        (dict(frames=FLAT), r"frames has shape \(32, 32\); store 2 to 256"),
        (dict(frames=FLAT[None], light_direction=lights()[:1]), "store 2 to 256"),
        (dict(frames=np.zeros((257, 2, 2))), "store 2 to 256"),
        (dict(frames=np.zeros((N_LED, 0, SIZE))), "store 2 to 256"),
        (dict(frames=np.ones((N_LED, SIZE, SIZE), np.uint16)), "frames holds uint16; divide by"),
        (dict(frames=np.full((N_LED, SIZE, SIZE), "dark")), "frames is an array of <U4"),
        (put("frames", (0, 0, 0), np.nan), "frames is not finite"),
        (put("frames", (0, 0, 0), -0.01), "frames has negative values"),
        (dict(light_direction=lights()[1:]), r"light_direction .* shape \(11, 3\); .* need .* \(12, 3\)"),
        (dict(light_direction=lights() * 1j), "light_direction is an array of complex128"),
        (put("light_direction", (2, 1), np.inf), "light_direction is not finite"),
        (put("light_direction", 3, 0), "light_direction holds a zero vector"),
        (dict(normal=FLAT), r"normal .* shape \(32, 32\); .* need .* \(32, 32, 3\)"),
        (put("normal", MIDDLE, 2), "normal has not unit length"),
        (put("normal", MIDDLE, np.nan), "normal has not unit length"),
        (dict(reflectance=FLAT), r"reflectance .* shape \(32, 32\); .* need .* \(32, 32, 1\)"),
        (dict(mask=FLAT[1:]), r"mask .* shape \(31, 32\); .* need .* \(32, 32\)"),
    ],
)
def test_a_bad_stack_is_refused(save, changes, sentence):
    path = save(**changes)
    with pytest.raises(InputError, match=f"stack.npz: .*{sentence}") as refused:
        read_stack(path)
    assert "\n" not in str(refused.value) and str(refused.value).endswith(".")


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def spoil(path):
    content = bytearray(path.read_bytes())
    content[1000:1100] = bytes(100 * [255])
    path.write_bytes(content)


def overwrite(path):
    path.write_text("photographs")


def save_single(path):
    with path.open("wb") as file:
        np.save(file, FLAT)


def save_pickled(path):
    np.savez(path, frames=np.array([{}]), light_direction=lights())


@pytest.mark.parametrize("damage", [cut, spoil, overwrite, save_single, save_pickled])
def test_a_damaged_file_is_refused(save, damage):
    path = save()
    damage(path)
    with pytest.raises(InputError, match="stack.npz: this is not a readable .npz archive"):
        read_stack(path)


def test_a_missing_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "none.npz"):
        with pytest.raises(InputError, match="there is no such file"):
            read_stack(path)


def test_a_good_stack_is_read_as_it_is(save):
    stack, wanted = read_stack(save()), sphere()
    assert stack.frames.dtype == np.float32
    np.testing.assert_array_equal(stack.frames, wanted["frames"].astype(np.float32))
    np.testing.assert_allclose(stack.light_direction, lights(), rtol=1e-12)
    for name in ("normal", "reflectance", "mask"):
        np.testing.assert_array_equal(getattr(stack.truth, name), wanted[name])


def test_normals_outside_the_mask_may_be_anything(save):
    normal = np.where(sphere()["mask"][..., None], sphere()["normal"], np.nan)
    assert read_stack(save(normal=normal)).truth.mask.sum() == sphere()["mask"].sum()


def test_an_unknown_truth_counts_nowhere(save):
    truth = read_stack(save(normal=None, reflectance=None, mask=None)).truth
    assert not truth.mask.any()
    assert truth.normal.shape == (SIZE, SIZE, 3) and truth.reflectance.shape == (SIZE, SIZE, 1)


def test_scene_parameters_are_refused(save, tmp_path, capsys):
    argv = ("--frames", str(save()), "--out", str(tmp_path / "out"), "-D", "size=64")
    assert simulate.main(list(argv)) == 2
    assert (
        capsys.readouterr().err == "error: -D sets parameters of a scene file; leave it out with --frames.\n"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "dark_slot, largest_angle, largest_deviation",  # measured: 1.2 degrees and 5.5 %, 0.3 degrees and 0.5 %
    [((), 2.0, 0.1), ((-1,), 0.6, 0.01)],
)
def test_events_lead_back_to_the_sphere(save, tmp_path, dark_slot, largest_angle, largest_deviation):
    out, true = tmp_path / "out", sphere()
    np.save(tmp_path / "mask.npy", true["mask"])
    recording = ("--frames", save(), "--out", out, "--ideal", "--constant-light", "0.02")
    assert simulate.main([*map(str, recording), "--order", *map(str, (*range(N_LED), *dark_slot))]) == 0
    fitting = (out / "scene.xml", out / "events.h5", "--mask", tmp_path / "mask.npy", "--preset", "fast")
    assert fit.main([*map(str, fitting)]) == 0
    maps = np.load(out / "events" / "maps.npz")
    assert angular_error_deg(maps["normal"], true["normal"])[true["mask"]].mean() < largest_angle
    known = true["mask"] & maps["mask"]
    assert known.sum() > 0.85 * true["mask"].sum()
    assert np.median(np.abs(maps["reflectance"][known] / REFLECTANCE - 1)) < largest_deviation
