"""From event pairs to maps."""
