"""`python -m evsdr.fit`: recover normals and absolute reflectance from a recording; see `evsdr.commands.fit`."""

if __name__ == "evsdr.fit":
    raise ImportError("evsdr.fit is a command, run by python -m evsdr.fit; import evsdr.commands.fit.")
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("fit")
