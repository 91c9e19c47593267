"""The layer of the image as the model explains it."""

from collections.abc import Iterator, Mapping
from typing import Any, cast

from napari.components import ViewerModel
from napari.layers import Image

from napari_splinesketch.plugin.adapter.film import Film, Patch
from napari_splinesketch.plugin.adapter.roles import look_of, put
from napari_splinesketch.plugin.adapter.space import frame_shape, placement_on


class ModelPicture:
    """Shows reconstructions, the frames that are known; hidden until the user wants to see it.

    Parameters
    ----------
    viewer
        Where the layer is added, above the image.
    image
        What was explained.
    keywords
        Name and metadata of the layer.
    """

    def __init__(self, viewer: ViewerModel, image: Image, keywords: Mapping[str, Any]):
        self._viewer, self._image, self._keywords = viewer, image, keywords
        self._layer: Image | None = None
        self._pictured: Mapping[int, Patch] | None = None

    @property
    def layer(self) -> Image | None:
        """The layer, or None where there is none or the user removed it."""
        return self._layer if self._layer in self._viewer.layers else None

    def show(self, patches: Mapping[int, Patch]) -> Iterator[Image]:
        """Show what is known; a layer that is new is given, for others to listen to."""
        layer = self.layer
        if (layer or not patches) and patches is self._pictured:
            return
        self._pictured = patches
        if not patches:
            if layer:
                self._viewer.layers.remove(layer)
            return
        film = Film(patches, frame_shape(self._image))
        where = placement_on(self._image, film.grid.origin, film.grid.step)
        if layer is not None and layer.data.shape == film.shape:
            layer.data = cast(Any, film)
            for name, value in where.items():
                setattr(layer, name, value)
            return
        visible = layer.visible if layer else False
        if layer:
            self._viewer.layers.remove(layer)
        look = look_of(self._image)
        self._layer = Image(
            cast(Any, film), multiscale=False, visible=visible, **look, **self._keywords, **where
        )
        put(self._viewer, self._layer, self._viewer.layers.index(self._image) + 1)
        yield self._layer
