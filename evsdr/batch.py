"""`python -m evsdr.batch`: many fits, each in a process of its own; see `evsdr.commands.batch`."""

if __name__ == "evsdr.batch":
    raise ImportError("evsdr.batch is a command, run by python -m evsdr.batch; import evsdr.commands.batch.")
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("batch")
