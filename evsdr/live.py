"""`python -m evsdr.live`: normals of the last round, many times a second; see `evsdr.commands.live`."""

if __name__ == "evsdr.live":
    raise ImportError("evsdr.live is a command, run by python -m evsdr.live; import evsdr.commands.live.")
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("live")
