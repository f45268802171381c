"""`python -m evsdr.view`: look at a file of events before it is fitted; see `evsdr.commands.view`."""

if __name__ == "evsdr.view":
    raise ImportError("evsdr.view is a command, run by python -m evsdr.view; import evsdr.commands.view.")
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("view")
