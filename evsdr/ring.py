"""`python -m evsdr.ring`: run the ring of LEDs; see `evsdr.commands.ring`."""

if __name__ == "evsdr.ring":
    raise ImportError("evsdr.ring is a command, run by python -m evsdr.ring; import evsdr.commands.ring.")
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("ring")
