"""What becomes of surfaces that are not matt."""
