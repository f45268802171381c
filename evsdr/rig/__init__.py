"""The real ring, cameras and their files."""
