"""Clip planes let everything be seen, and those of a scene file stay."""

import mitsuba as mi
import pytest

from evsdr.light.clip_planes import open_clip_planes
from tests.support.ring_scenes import camera

BOX = mi.BoundingBox3f([-1, -1, -1], [1, 1, 1])


def planes(distance, box=BOX, perspective=False, **told):
    """Give the planes of a camera that looks at the box from a distance."""
    sensor = mi.load_dict(camera((0, 0, distance), perspective=perspective) | told)
    open_clip_planes(sensor, box)
    now = mi.traverse(sensor)
    ray, _ = sensor.sample_ray(0.0, 0.5, [0.5, 0.5], [0.5, 0.5])
    return now["near_clip"], now["far_clip"], float(ray.o.z[0]), float(ray.maxt[0])


@pytest.mark.parametrize("perspective", [False, True])
def test_they_move_only_where_they_cut(perspective):
    near, far, _, _ = planes(10.0, perspective=perspective)
    assert (near, far) == pytest.approx((1e-2, 1e4))
    _, far, start, length = planes(1e6, perspective=perspective)
    assert far > 1e6 + 1 and start == pytest.approx(1e6) and length > 1e6
    tiny = mi.BoundingBox3f([-1e-6, -1e-6, -1e-6], [1e-6, 1e-6, 1e-6])
    near, _, start, _ = planes(1e-5, tiny, perspective)
    assert near < 9e-6 and 1e-6 < start < 1e-5


def test_those_that_are_told_stay():
    near, far, _, _ = planes(1e6, near_clip=3.0, far_clip=5.0)
    assert (near, far) == (3.0, 5.0)


def test_nothing_before_the_camera_changes_nothing():
    assert planes(10.0, mi.BoundingBox3f([0, 0, 11], [1, 1, 12]))[:2] == pytest.approx((1e-2, 1e4))
    assert planes(10.0, mi.BoundingBox3f())[:2] == pytest.approx((1e-2, 1e4))
