"""The napari plugin: the only package that knows napari and Qt."""
