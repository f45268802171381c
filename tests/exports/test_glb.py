"""The container of glTF: what is put in comes out, and every part is told as long as it is."""

import numpy as np

from evsdr.exports.glb import Buffer, write_glb
from tests.support.glb_file import accessor, read_glb


def test_it_is_read_back(tmp_path, rng):
    buffer = Buffer()
    buffer.view(b"abc")  # not a multiple of four bytes
    values, face = rng.normal(size=(5, 3)).astype(np.float32), rng.integers(0, 5, (4, 3))
    assert [buffer.attribute(values), buffer.corners(face)] == [0, 1]
    write_glb(tmp_path / "a.glb", {"asset": {"version": "2.0"}, "extra": "µ"}, buffer)
    document, data = read_glb(tmp_path / "a.glb")
    assert document["extra"] == "µ" and document["buffers"] == [{"byteLength": len(data)}]
    np.testing.assert_array_equal(accessor(document, data, 0), values)
    np.testing.assert_array_equal(accessor(document, data, 1).ravel(), face.ravel())
    assert data[:3] == b"abc"
    np.testing.assert_array_equal(document["accessors"][0]["min"], values.min(axis=0))
    np.testing.assert_array_equal(document["accessors"][0]["max"], values.max(axis=0))
