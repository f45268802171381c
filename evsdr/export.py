"""`python -m evsdr.export`: hand results on to other programs; see `evsdr.commands.export`."""

if __name__ == "evsdr.export":
    raise ImportError(
        "evsdr.export is a command, run by python -m evsdr.export; import evsdr.commands.export."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("export")
