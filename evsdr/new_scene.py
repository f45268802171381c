"""`python -m evsdr.new_scene`: a scene from a table of LEDs; see `evsdr.commands.new_scene`."""

if __name__ == "evsdr.new_scene":
    raise ImportError(
        "evsdr.new_scene is a command, run by python -m evsdr.new_scene; import evsdr.commands.new_scene."
    )
if __name__ == "__main__":
    from evsdr.door import open_door

    open_door("new_scene")
