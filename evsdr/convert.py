"""`python -m evsdr.convert`: join a camera's recording and the ring's log; see `evsdr.commands.convert`."""

if __name__ == "evsdr.convert":
    raise ImportError(
        "evsdr.convert is a command, run by python -m evsdr.convert; import evsdr.commands.convert."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("convert")
