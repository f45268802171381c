"""`python -m evsdr.calibrate`: measure a rig; see `evsdr.commands.calibrate`."""

if __name__ == "evsdr.calibrate":
    raise ImportError(
        "evsdr.calibrate is a command, run by python -m evsdr.calibrate; import evsdr.commands.calibrate."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("calibrate")
