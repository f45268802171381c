"""Normals while a recording runs: of the events of its last round, by a few steps of a small solver."""
