"""Scene library: Mitsuba scenes of a ring of LEDs, and the scripts that write their parts."""
