"""Measuring a rig."""
