"""What pixels tell of each other."""
