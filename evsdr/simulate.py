"""`python -m evsdr.simulate`: record a scene with simulated event pixels; see `evsdr.commands.simulate`."""

if __name__ == "evsdr.simulate":
    raise ImportError(
        "evsdr.simulate is a command, run by python -m evsdr.simulate; import evsdr.commands.simulate."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("simulate")
