"""Mitsuba plugins of evsdr; import them after a variant is set (`evsdr.jit.start` does both)."""
