"""Read the image: background, contrast, noise, width."""
