"""The thin layer over Mitsuba."""
