"""The ring's firmware on a simulated ATmega328P: protocol, pins, light, events, normals."""
