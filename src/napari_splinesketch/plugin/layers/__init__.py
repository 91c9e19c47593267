"""All knowledge of napari's layers: coordinates, units, frames, pixels, shapes, results."""
