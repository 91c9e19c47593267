"""The JAX engine: sketches and an image in, curves out. No Qt, no napari, no files."""
