"""A scene file can't run code, hang, or ask for no end of work; what scenes need is let through."""

import os
import shutil
import struct
import subprocess
import sys
import zlib

import mitsuba as mi
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.jit import threads_for_images
from evsdr.light import scene_file
from evsdr.light.scene import load_scene
from evsdr.light.scene_file import check_scene_file, image_size, known_plugins
from tests.conftest import REPOSITORY
from tests.support.small_scene import SPHERE, leds, scene


def check(folder, text, **define):
    """Write a scene and look at it."""
    (folder / "scene.xml").write_bytes(text if isinstance(text, bytes) else text.encode())
    return check_scene_file(folder / "scene.xml", define, ())


def of_type(kind, before=""):
    return scene(shape=before + SPHERE.replace('"diffuse"', f'"{kind}"'))


def default(name, value):
    return f'<default name="{name}" value="{value}"/>'


def textured(name, kind="bitmap"):
    texture = f'<texture type="{kind}" name="reflectance"><string name="filename" value="{name}"/></texture>'
    return scene(shape=f'<shape type="sphere" id="object"><bsdf type="diffuse">{texture}</bsdf></shape>')


def png(width, height):
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"\0" * (width + 1) * height)), (b"IEND", b"")]
    parts = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize("name", sorted(path.name for path in (REPOSITORY / "scenes").glob("*.xml")))
def test_all_our_scenes_are_let_through(name):
    assert check_scene_file(REPOSITORY / "scenes" / name, {}, ()) == {REPOSITORY / "scenes"}


def test_stock_plugins_and_ours_are_known():
    assert {"ring", "diffuse", "ply", "prb", "irregular", "hdrfilm"} <= known_plugins()
    assert not {"x", "", "..", "__init__.py"} & known_plugins()


@pytest.mark.parametrize(
    "text, define",
    [
        (of_type("x"), {}),
        (of_type("../x"), {}),
        (of_type("/tmp/diffuse"), {}),
        (of_type(""), {}),
        (of_type("$a", default("a", "x")), {}),
        (of_type("$a", default("b", "x") + default("a", "$b")), {}),
        (scene(shape=SPHERE.replace('"diffuse"', '"$a"') + default("a", "x")), {}),
        (of_type("$a"), {"a": "x"}),
        (of_type("$a"), {"a": "$b", "b": "x"}),
        (of_type("dif$a", default("a", "fuse/../x")), {}),
        (of_type("&#x2e;&#x2e;/x"), {}),
        (scene(light=leds(8) + '<spectrum type="x" name="a"/>'), {}),
    ],
)
def test_other_plugins_are_refused(tmp_path, text, define):
    with pytest.raises(InputError, match='scene.xml: .* plugin of type ".*" not found among Mitsuba'):
        check(tmp_path, text, **define)


@pytest.mark.parametrize(
    "text", [of_type("$ab", default("a", "x") + default("ab", "diffuse")), of_type("$no")]
)
def test_what_mitsuba_reads_otherwise_is_let_through(tmp_path, text):
    """The longest name counts; and what is not known Mitsuba refuses itself."""
    check(tmp_path, text)


def test_paths_and_document_types_are_refused(tmp_path):
    with pytest.raises(InputError, match="an element <path>"):
        check(tmp_path, scene(shape='<path value="plugins"/>' + SPHERE))
    with pytest.raises(InputError, match="a document type"):
        check(tmp_path, '<!DOCTYPE a [<!ENTITY b "c">]>' + scene())


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_text_that_parsers_may_read_differently_is_refused(tmp_path, encoding):
    text = f'<?xml version="1.0" encoding="{encoding}"?><!-- \xfc -->' + scene()
    with pytest.raises(InputError, match="well-formed|encoding is|document element"):
        check(tmp_path, text.encode(encoding))
    check(tmp_path, '<?xml version="1.0" encoding="utf-8"?><!-- \xfc -->' + scene())
    check(tmp_path, b'<?xml version="1.0" encoding="ISO-8859-1"?>' + scene().encode())


def test_includes_are_looked_at(tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "part.xml").write_text('<scene version="3.0.0">' + SPHERE + "</scene>")
    include = '<include filename="deep/part.xml"/>'
    assert check(tmp_path, scene(shape=include)) == {tmp_path, tmp_path / "deep"}
    (tmp_path / "deep" / "part.xml").write_text('<scene version="3.0.0"><bsdf type="x"/></scene>')
    with pytest.raises(InputError, match='part.xml: .*"x" not found'):
        check(tmp_path, scene(shape=include))
    name = default("name", "part") + '<include filename="deep/$name.xml"/>'
    with pytest.raises(InputError, match='"x" not found'):
        check(tmp_path, scene(shape=name))


def test_files_that_include_themselves_are_refused(tmp_path):
    with pytest.raises(InputError, match="include each other more than 15 deep"):
        check(tmp_path, scene(shape='<include filename="scene.xml"/>'))


@pytest.mark.parametrize(
    "text, says",
    [
        (scene(shape='<bsdf type="twosided">' * 20_000 + "</bsdf>" * 20_000), "nested more than 50 deep"),
        (scene(shape=SPHERE + "<ref/>" * 1001), "more than 1000 elements"),
        (scene(shape=SPHERE + f'<float name="a" value="0.{"1" * 5000}"/>'), "a number of 5002 characters"),
        (
            of_type("$a", "".join(default("a", f"{k}") for k in range(100))),
            "more than 64 values",
        ),
        (
            scene(shape=default("a", "$b$b") + default("b", "$a$a") + default("a", "1")),
            "without end|more than",
        ),
        (scene() + " " * 100_000, "larger than 0 MiB"),
    ],
)
def test_all_is_bounded(tmp_path, monkeypatch, text, says):
    monkeypatch.setattr(scene_file, "MOST_ELEMENTS", 1000 if "<ref/>" in text else 10**6)
    monkeypatch.setattr(scene_file, "MOST_BYTES", 10_000 if text.endswith(" ") else 10**7)
    with pytest.raises(InputError, match=says):
        check(tmp_path, text)


def test_parameters_that_hold_each_other_end(tmp_path):
    """Values grow with every round; names in default values are looked at, too."""
    check(tmp_path, scene(shape=default("a", "1") + default("b", "$a") + default("c", "$b") + SPHERE))


@pytest.mark.parametrize("kind", ["bitmap", "ply", "obj", "serialized"])
def test_only_regular_files_are_opened(tmp_path, kind):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    for name in ("fifo", "folder", "/dev/zero", "../../../../../../dev/zero"):
        with pytest.raises(InputError, match="is no regular file"):
            check(tmp_path, textured(name, kind))
    with pytest.raises(InputError, match="is no regular file"):
        check(tmp_path, scene(shape='<include filename="fifo"/>'))
    check(tmp_path, textured("missing.png", kind))  # of which Mitsuba tells
    with pytest.raises(InputError, match="zero byte|well-formed"):
        check(tmp_path, textured("a&#0;b", kind))


def test_files_are_of_their_kind(tmp_path):
    (tmp_path / "a.png").write_bytes(png(3, 2))
    (tmp_path / "a.ply").write_bytes(b"ply\n")
    check(tmp_path, textured("a.png"))
    check(tmp_path, textured("a.ply", "ply"))
    for name, kind in (("a.ply", "bitmap"), ("a.png", "ply"), ("scene.xml", "serialized")):
        with pytest.raises(InputError, match=f'"{name}" is no file for the plugin {kind}'):
            check(tmp_path, textured(name, kind))


@pytest.mark.parametrize("kind", ["bitmap", "ply"])
def test_plugins_that_read_a_file_must_name_one(tmp_path, kind):
    """Mitsuba's bitmap without one ends the process."""
    text = textured("x.png", kind).replace('name="filename"', 'name="constant_light"')
    with pytest.raises(InputError, match=f'type "{kind}" names no file'):
        check(tmp_path, text)


@pytest.mark.parametrize("old, new", [("430:0.3", "-inf:0.3"), ("430:0.3", "430:NaN"), ("430:0.3", "430:$c")])
def test_spectra_are_finite(tmp_path, old, new):
    with pytest.raises(InputError, match="holds a number that is not finite"):
        check(tmp_path, scene().replace(old, new), c="Infinity")
    check(tmp_path, scene().replace("led_", "inf_"))  # a name


def test_images_are_no_larger_than_any_film(tmp_path):
    data = bytearray(png(1, 1))
    data[16:24] = struct.pack(">II", 1 << 15, 1 << 14)
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(InputError, match="32768 x 16384 pixels, too many"):
        check(tmp_path, textured("a.png"))


def test_sizes_of_images_are_read():
    assert image_size(png(3, 2)) == (3, 2)
    bmp = b"BM" + b"\0" * 16 + struct.pack("<ii", 5, -4)
    assert image_size(bmp) == (5, 4)
    exr = (
        b"\x76\x2f\x31\x01"
        + b"\0" * 9
        + b"dataWindow\0box2i\0"
        + struct.pack("<I", 16)
        + struct.pack("<4i", 0, 0, 6, 7)
    )
    assert image_size(exr) == (7, 8)
    assert image_size(b"P6") == image_size(png(3, 2)[:20]) == image_size(exr[:-1]) == (0, 0)


def test_exr_files_of_mitsuba_are_measured(tmp_path):
    with threads_for_images():
        mi.Bitmap(np.zeros((4, 6, 3), np.float32)).write(str(tmp_path / "a.exr"))
    assert image_size((tmp_path / "a.exr").read_bytes()) == (6, 4)


def test_one_thread_reads_them(tmp_path):
    """Mitsuba alone would wait for ever."""
    with threads_for_images():
        mi.Bitmap(np.full((40, 40, 3), 0.5, np.float32)).write(str(tmp_path / "a.exr"))
    (tmp_path / "scene.xml").write_text(textured("a.exr"))
    command = [
        sys.executable,
        "-c",
        "import sys, evsdr; evsdr.load_scene(sys.argv[1])",
        tmp_path / "scene.xml",
    ]
    subprocess.run(command, env=os.environ | {"EVSDR_THREADS": "1"}, check=True, timeout=120)


def test_what_can_not_be_read_is_said(tmp_path):
    with pytest.raises(InputError, match="can't be read"):
        check_scene_file(tmp_path / "no.xml", {}, ())
    with pytest.raises(InputError, match="no regular file"):
        check_scene_file(tmp_path, {}, ())


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_library_beside_the_scene_is_not_run(tmp_path):
    """Not as a plugin of its own, nor under the name of one of Mitsuba's."""
    code = f'#include <stdio.h>\n__attribute__((constructor)) void f(void) {{ fclose(fopen("{tmp_path}/ran", "w")); }}'
    (tmp_path / "x.c").write_text(code)
    (tmp_path / "plugins").mkdir()
    for name in ("x", "diffuse"):
        target = tmp_path / "plugins" / f"{name}.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-o", target, tmp_path / "x.c"], check=True)
    (tmp_path / "good.xml").write_text(scene())
    (tmp_path / "bad.xml").write_text(of_type("x"))
    with pytest.raises(InputError, match='"x" not found'):
        load_scene(tmp_path / "bad.xml")
    program = f"import evsdr; evsdr.load_scene({str(tmp_path / 'good.xml')!r})"  # nothing loaded yet
    subprocess.run([sys.executable, "-c", program], check=True, cwd=REPOSITORY)
    assert not (tmp_path / "ran").exists()
