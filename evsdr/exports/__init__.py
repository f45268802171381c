"""Hand results on to other programs: one module per kind of file."""
