"""What all pixels share, inferred together with the maps of some."""
