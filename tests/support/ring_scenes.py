"""Small scenes before the ring integrator, as dictionaries."""

import mitsuba as mi
import numpy as np

POWER = 470.0  # INT dlambda of a flat spectrum of 1, over Mitsuba's 360 to 830 nm
WIDTH, HEIGHT = 16, 12


def spectrum(value) -> dict:
    """A number, or pairs (wavelength, value)."""
    return {"type": "spectrum", "value": value}


def peak(centre_nm, power=1.0, sigma_nm=10.0):
    nm = np.arange(centre_nm - 5 * sigma_nm, centre_nm + 5.1 * sigma_nm, sigma_nm / 2)
    density = np.exp(-0.5 * ((nm - centre_nm) / sigma_nm) ** 2)
    return list(zip(nm.tolist(), (power * density / np.trapezoid(density, nm)).tolist()))


def diffuse(reflectance=1.0):
    return {"type": "diffuse", "reflectance": spectrum(reflectance)}


def far(to_light, irradiance=1.0):
    direction = (-np.array(to_light, float)).tolist()
    return {"type": "directional", "direction": direction, "irradiance": spectrum(irradiance)}


def near(position, intensity=1.0):
    return {"type": "point", "position": list(position), "intensity": spectrum(intensity)}


def soft(position, half_width, radiance=1.0, target=(0, 0, 0)):
    """A square light that faces the target."""
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(list(position), list(target), [0.1, 1, 0.2])
    light = {"type": "area", "radiance": spectrum(radiance)}
    return {"type": "rectangle", "to_world": to_world @ transform().scale(half_width), "emitter": light}


def plane(reflectance=1.0, angle=0.0, axis=(0, 1, 0), at=(0, 0, 0), half_width=(20, 20, 1), bsdf=None):
    transform = mi.ScalarTransform4f
    turn = transform().rotate((np.array(axis) / np.linalg.norm(axis)).tolist(), angle)
    to_world = transform().translate(list(at)) @ turn @ transform().scale(list(half_width))
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf or diffuse(reflectance)}


def camera(origin=(0, 0, 10), up=(0, 1, 0), half_width=1.0, response=None, perspective=False, **film):
    """A camera that looks at the world's origin; with a response its film holds INT D L dlambda."""
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(list(origin), [0, 0, 0], list(up))
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}} | film
    if response is not None:
        film |= {"type": "specfilm", "band": spectrum(response)}
    if perspective:
        return {"type": "perspective", "fov": 12, "to_world": to_world, "film": film}
    to_world = to_world @ transform().scale([half_width, half_width, 1])
    return {"type": "orthographic", "to_world": to_world, "film": film}


def load(objects, view=None):
    return mi.load_dict({"type": "scene", "camera": view or camera()} | objects, optimize=False)


def ring(**parameters):
    parameters = {k: spectrum(v) if k == "response" else v for k, v in parameters.items()}
    return mi.load_dict({"type": "ring"} | parameters)


def render(scene, spp=1, seed=0, **parameters):
    return np.array(ring(**parameters).render(scene, spp=spp, seed=seed), dtype=float)


def pixel_centres(half_width=1.0):
    """x and y (H, W) in the camera frame."""
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * half_width
    y = -((np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1) * half_width * HEIGHT / WIDTH
    return np.meshgrid(x, y)


def ball_normals():
    """A ball looks the same from everywhere: normals (H, W, 3) in the camera frame and where it is."""
    x, y = pixel_centres()
    z2 = 1 - x**2 - y**2
    return np.stack([x, y, np.sqrt(np.maximum(z2, 0))], axis=-1), z2 > 0


# A roof at height 1 hides x < 0.3 from the camera; light from the left draws its shadow's edge at x = 1.3.
ROOF = {"object": plane(), "roof": plane(at=(-9.7, 0, 1), half_width=(10, 20, 1))}
SHADOW_EDGE_COLUMN, LIT_SHARE = 13, 0.8  # pixel from x = 1.25 to 1.5 where the view is 4 wide


def square_points(position, half_width, n=60):
    """Points (n * n, 3) on the square light that faces the origin, and its normal."""
    matrix = np.array(soft(position, half_width)["to_world"].matrix, dtype=float)
    u = (np.arange(n) + 0.5) / n * 2 - 1
    grid = np.stack([*np.meshgrid(u, u), np.zeros((n, n)), np.ones((n, n))], axis=-1).reshape(-1, 4)
    return (grid @ matrix.T)[:, :3], -np.array(position) / np.linalg.norm(position)


def brute_force(surface_point, position, half_width):
    """Points of a square light of radiance 1: where (n, 3), in what direction (n, 3), dA cos / d^2 (n)."""
    point, light_normal = square_points(position, half_width)
    to_light = point - surface_point
    distance = np.linalg.norm(to_light, axis=1, keepdims=True)
    direction = to_light / distance
    area = (2 * half_width) ** 2
    return point, direction, -(direction @ light_normal) * area / len(point) / distance[:, 0] ** 2
