"""What a scene file names, looked at before Mitsuba sees it: a scene can't run code, hang, or ask for no end of work.

Mitsuba loads plugins as code and opens whatever a file names. Here the XML and its includes are read by Python's own
parser: plugins must be Mitsuba's or `ring`, files that are named regular and of their kind, all within bounds.
"""

import re
import stat
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from xml.parsers import expat

from evsdr.errors import InputError

OURS = ("ring",)
MOST_BYTES, MOST_ELEMENTS, MOST_DEPTH = 64 << 20, 200_000, 50  # of all files together; of nesting
MOST_INCLUDES = 15  # of files in files, as Mitsuba
MOST_VALUES = 64  # that `$names` of one attribute may stand for
MOST_ROUNDS = 8  # until all of them are known
LONGEST_NUMBER, LONGEST_TEXT = 64, 1 << 12  # characters; of texts in which `$names` are replaced
MOST_TEXELS = 1 << 28
HEAD = 1 << 16  # bytes of a file that tell its kind
NUMBERS = ("integer", "float", "boolean")
NOT_FINITE = re.compile(r"(?i)\b(nan|inf|infinity)\b")
ENCODINGS = (None, "utf-8", "us-ascii", "ascii")
KINDS = {  # how files of a plugin start; None: images
    "ply": (b"ply",),
    "serialized": (b"\x1c\x04",),
    "bitmap": None,
    "envmap": None,
}
IMAGES = (b"\x89PNG", b"\xff\xd8", b"\x76\x2f\x31\x01", b"#?", b"BM", *(b"P%c" % c for c in b"123456fF"))


@dataclass
class Element:
    """An element of a scene file."""

    tag: str
    attributes: dict
    children: list = field(default_factory=list)


@dataclass
class Looked:
    """What was seen so far: values of `$names`, whether -D sets them, and the bounds that are used up."""

    values: dict
    fixed: frozenset
    folders: tuple[Path, ...]
    bytes: int = 0
    elements: int = 0
    files: set = field(default_factory=set)


def check_scene_file(path: Path, define: dict[str, str], folders: tuple[Path, ...]) -> set[Path]:
    """Refuse a scene file that names what no scene needs.

    Parameters
    ----------
    path : Path
    define : dict
        Values for the file's `<default>` parameters.
    folders : tuple of Path
        Where Mitsuba looks for files beside the scene's own folder.

    Returns
    -------
    set of Path
        Folders of the scene and of its includes.

    Raises
    ------
    InputError
        The sentence names the file.
    """
    values, known = {name: {value} for name, value in define.items()}, -1
    for _ in range(MOST_ROUNDS):  # values may come after their use, and hold other names
        looked = Looked(values, frozenset(define), (path.parent, *folders))
        _look(path, looked, 0)
        if known == (known := sum(map(len, values.values()))):
            return {file.parent for file in looked.files}
    raise _refuse(path, "its <default> parameters refer to each other without end")


def _refuse(path: Path, what: str) -> InputError:
    return InputError(f"{path}: Mitsuba can't load it: {what}; correct the file, or what -D sets in it.")


def _look(path: Path, looked: Looked, depth: int) -> None:
    """Look at a file and those that it includes."""
    if depth > MOST_INCLUDES:
        raise _refuse(path, f"files include each other more than {MOST_INCLUDES} deep")
    root = _parse(path, looked)
    looked.files.add(path)
    stack = [root]
    while stack:
        element = stack.pop()
        stack += reversed(element.children)
        _look_at(element, path, looked)
        if element.tag == "include":
            for name in _values(element.attributes.get("filename", ""), looked, path):
                for file in _found(name, path, looked):
                    _look(file, looked, depth + 1)


def _look_at(element: Element, path: Path, looked: Looked) -> None:
    """Look at one element."""
    tag, attributes = element.tag, element.attributes
    if tag == "path":
        raise _refuse(path, "it has an element <path>, which would look for plugins elsewhere")
    if tag == "default":
        name = attributes.get("name", "")
        if name not in looked.fixed:
            looked.values.setdefault(name, set()).update(_values(attributes.get("value", ""), looked, path))
    for kind in _values(attributes.get("type", ""), looked, path):
        if "type" in attributes and kind not in known_plugins() and "$" not in kind:
            raise _refuse(
                path, f'it asks for a {tag} plugin of type "{kind}": "{kind}" not found among Mitsuba\'s own'
            )
        named = [c for c in element.children if c.tag == "string" and c.attributes.get("name") == "filename"]
        if "type" in attributes and kind in KINDS and not named:
            raise _refuse(path, f'a plugin of type "{kind}" names no file')
        for child in named:
            _look_at_files(child.attributes.get("value", ""), kind, path, looked)
    if "filename" in attributes and tag != "include":
        _look_at_files(attributes["filename"], "", path, looked)
    if tag == "spectrum":
        for value in _values(attributes.get("value", ""), looked, path):
            if ":" in value and NOT_FINITE.search(value):
                raise _refuse(
                    path, f"<{tag} name={attributes.get('name')!r}> holds a number that is not finite"
                )
    if tag in NUMBERS:
        for value in _values(attributes.get("value", ""), looked, path):
            if len(value) > LONGEST_NUMBER:
                raise _refuse(
                    path, f"a number of {len(value)} characters at <{tag} name={attributes.get('name')!r}>"
                )


def _look_at_files(text: str, kind: str, path: Path, looked: Looked) -> None:
    """Look at files that a plugin names: they must be regular, and of its kind."""
    for name in _values(text, looked, path):
        for file in _found(name, path, looked):
            with file.open("rb") as stream:
                head = stream.read(HEAD)
            starts = IMAGES if KINDS.get(kind, ()) is None else KINDS.get(kind, ())
            if starts and not head.startswith(starts) and file.suffix.lower() != ".tga":
                raise _refuse(path, f'"{name}" is no file for the plugin {kind}')
            width, height = image_size(head)
            if width * height > MOST_TEXELS:
                raise _refuse(path, f'the image "{name}" has {width} x {height} pixels, too many')


def image_size(head: bytes) -> tuple[int, int]:
    """Give the size that the start of a PNG, BMP or EXR file declares; (0, 0) where it declares none."""
    if head.startswith(b"\x89PNG") and len(head) >= 24:
        return struct.unpack(">II", head[16:24])
    if head.startswith(b"BM") and len(head) >= 26:
        width, height = struct.unpack("<ii", head[18:26])
        return abs(width), abs(height)
    window = head.find(b"dataWindow\0box2i\0") + 21 if head.startswith(b"\x76\x2f\x31\x01") else 20
    if window > 20 and len(head) >= window + 16:
        left, top, right, bottom = struct.unpack("<iiii", head[window : window + 16])
        return max(right - left + 1, 0), max(bottom - top + 1, 0)
    return 0, 0


def _found(name: str, path: Path, looked: Looked) -> Iterator[Path]:
    """Give all files that Mitsuba might take for a name; one that is missing it misses itself."""
    if "\0" in name:
        raise _refuse(path, "a file name holds a zero byte")
    for folder in dict.fromkeys((*looked.folders, path.parent)):
        try:
            file = folder / name
            mode = file.stat().st_mode
        except (OSError, ValueError):
            continue
        if not stat.S_ISREG(mode):
            raise _refuse(path, f'"{name}" is no regular file')
        yield file


def _values(text: str, looked: Looked, path: Path) -> set[str]:
    """Give all that an attribute may stand for, `$names` replaced; Mitsuba refuses names that are not known."""
    if "$" in text and len(text) > LONGEST_TEXT:
        raise _refuse(path, f"a text with $ of {len(text)} characters")
    out = {text}
    for _ in range(MOST_ROUNDS):  # values may hold names themselves
        new = {value for old in out for value in _replaced(old, looked)}
        if len(new) > MOST_VALUES:
            raise _refuse(path, f'"{text}" may stand for more than {MOST_VALUES} values')
        if new == out:
            break
        out = new
    return out


def _replaced(text: str, looked: Looked) -> set[str]:
    """Replace the longest of the names in a text, as Mitsuba does, by each of its values."""
    names = [name for name in looked.values if name and f"${name}" in text]
    if not names or len(text) > LONGEST_TEXT:  # grown too long to be any name
        return {text}
    name = max(names, key=len)
    return {text.replace(f"${name}", value) for value in looked.values[name]}


@cache
def known_plugins() -> frozenset[str]:
    """Give the names of Mitsuba's plugins, and ours."""
    folder = Path(find_spec("mitsuba").origin).parent
    compiled = {re.sub(r"\..*", "", file.name) for file in (folder / "plugins").iterdir()}
    python = {file.stem for file in (folder / "python" / "ad" / "integrators").glob("*.py")}
    return frozenset({*OURS, *compiled, *python})


def _read(path: Path, looked: Looked) -> bytes:
    """Read a file, within bounds."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise _refuse(path, "it is no regular file")
        with path.open("rb") as stream:
            data = stream.read(MOST_BYTES - looked.bytes + 1)
    except OSError as error:
        raise InputError(
            f"{path}: it can't be read ({error.strerror}); give the path of a scene.xml."
        ) from error
    looked.bytes += len(data)
    if looked.bytes > MOST_BYTES:
        raise _refuse(path, f"with its includes it is larger than {MOST_BYTES >> 20} MiB")
    if b"<" not in data:
        raise _refuse(path, "No document element found")
    return data


def _parse(path: Path, looked: Looked) -> Element:
    """Read a file by the parser of Python; gives an element that holds its root."""
    data, stack = _read(path, looked), [Element("", {})]

    def start(tag, attributes):
        looked.elements += 1
        if looked.elements > MOST_ELEMENTS:
            raise _refuse(path, f"it has more than {MOST_ELEMENTS} elements")
        if len(stack) > MOST_DEPTH:
            raise _refuse(path, f"its elements are nested more than {MOST_DEPTH} deep")
        stack[-1].children.append(Element(tag, attributes))
        stack.append(stack[-1].children[-1])

    def declaration(_, encoding, __):
        if (encoding and encoding.lower()) not in ENCODINGS and not data.isascii():
            raise _refuse(path, f"its encoding is {encoding}; save it as UTF-8")

    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler, parser.EndElementHandler = start, lambda _: stack.pop()
    parser.XmlDeclHandler, parser.StartDoctypeDeclHandler = declaration, partial(_refuse_doctype, path)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise _refuse(path, f"it is no well-formed XML ({error})") from error
    return stack[0]


def _refuse_doctype(path: Path, *_) -> None:
    raise _refuse(path, "it has a document type, which no scene needs")
