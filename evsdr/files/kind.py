"""What kind a file is by its content, whatever its name: for sentences that help."""

from pathlib import Path

HDF5, RAW, XML = "HDF5, as a recording is", "a camera's RAW file", "XML, as a scene is"
XZ, AEDAT = "a xz file, as EventPS publishes recordings", "AEDAT4 of a camera"
STARTS = (
    (b"\x89HDF\r\n", HDF5),
    (b"PK\x03\x04", "an archive, as truth.npz and maps.npz are"),
    (b"\x93NUMPY", "an array of NumPy"),
    (b"\x89PNG", "an image"),
    (b"% ", RAW),
    (b"\xfd7zXZ\x00", XZ),
    (b"#!AER-DAT4", AEDAT),
    (b"<", XML),
    (b"{", "JSON, as ring.json is"),
)
REMEDY = dict.fromkeys((RAW, XZ, AEDAT), "join it with the ring's log by python -m evsdr.convert")


def kind_of(path: Path) -> str | None:
    """Tell the kind of a file, or None where its start tells nothing."""
    if path.is_dir():
        return "a folder"
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError:
        return None
    head = head.removeprefix(b"\xef\xbb\xbf").lstrip() if not head.startswith(b"\x89") else head
    return next((kind for start, kind in STARTS if head.startswith(start)), None)


def other_kind(path: Path, right: str, wanted: str) -> str:
    """Say what a file is instead of the right kind; nothing where it is that, or where it is not known."""
    kind = kind_of(path)
    if kind in (None, right):
        return ""
    return f"{path}: this is {kind}; {REMEDY.get(kind, f'name {wanted}')}."


def regular(path: Path) -> Path:
    """Give the path of a regular file; others, a FIFO say, would be waited for.

    Raises
    ------
    OSError
        It is none.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no regular file")
    return path
