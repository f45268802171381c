"""What a ring can tell, and how well."""
