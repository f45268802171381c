"""Events: the ring's phase, event pixels, photoreceptors, pairs."""
