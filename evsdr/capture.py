"""`python -m evsdr.capture`: record the ring with a camera; see `evsdr.commands.capture`."""

if __name__ == "evsdr.capture":
    raise ImportError(
        "evsdr.capture is a command, run by python -m evsdr.capture; import evsdr.commands.capture."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("capture")
