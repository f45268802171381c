"""The story of a fit."""
