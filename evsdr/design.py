"""`python -m evsdr.design`: judge a ring before it is built; see `evsdr.commands.design`."""

if __name__ == "evsdr.design":
    raise ImportError(
        "evsdr.design is a command, run by python -m evsdr.design; import evsdr.commands.design."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("design")
