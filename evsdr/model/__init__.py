"""The forward model on Dr.Jit arrays: light, surfaces, cameras."""
