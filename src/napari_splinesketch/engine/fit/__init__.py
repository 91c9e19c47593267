"""Fit splines to the image by differentiable rendering."""
