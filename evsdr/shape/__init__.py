"""From normals to surfaces."""
