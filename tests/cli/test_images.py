import os
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import imagecodecs
import imageio.v3
import numpy as np
import pytest
import tifffile
from PIL import Image

from napari_splinesketch import InputError
from napari_splinesketch.images.frames import LUMINANCE, is_part_of, open_frames
from napari_splinesketch.images.pictures import grey

from .fakes import film

FRAMES = film(4)


def write(path: Path, data: np.ndarray, **options: object) -> None:
    if data.shape[-1] != 3:
        options = {"photometric": "minisblack", **options}
    tifffile.imwrite(path, data, **options)  # pyright: ignore[reportArgumentType]


TIFFS: dict[str, tuple[dict[str, object], np.ndarray, dict[str, int]]] = {
    "plain": ({}, FRAMES[0], {}),
    "stack": ({"metadata": {"axes": "TYX"}}, FRAMES, {}),
    "planes": ({"metadata": {"axes": "ZYX"}}, FRAMES, {}),
    "LZW of another program": ({"compression": "lzw", "metadata": None}, FRAMES, {}),
    "LZW volume": ({"compression": "lzw", "volumetric": True, "tile": (1, 16, 16)}, FRAMES, {}),
    "big-endian": ({"byteorder": ">"}, FRAMES, {}),
    "hyperstack": (
        {"imagej": True, "metadata": {"axes": "TCYX"}},
        np.stack([FRAMES * 2, FRAMES], axis=1),
        {"channel": 1},
    ),
    "hyperstack, LZW": (
        {"imagej": True, "compression": "lzw", "metadata": {"axes": "TZCYX"}},
        np.stack([np.stack([FRAMES * 2, FRAMES], axis=1)] * 3, axis=1),
        {"channel": 1, "z": 2},
    ),
}


@pytest.mark.parametrize(("options", "data", "chosen"), TIFFS.values(), ids=TIFFS.keys())
def test_every_kind_of_tiff_gives_the_same_frames(
    tmp_path: Path, options: dict[str, object], data: np.ndarray, chosen: dict[str, int]
) -> None:
    write(tmp_path / "a.tif", data, **options)
    with open_frames(str(tmp_path / "a.tif"), **chosen) as frames:
        assert frames.count == (1 if data.ndim == 2 else 4)
        for i in reversed(range(frames.count)):
            assert np.array_equal(frames[i], FRAMES[i])


@pytest.mark.parametrize("of_times", [False, True])
def test_planes_without_a_name_are_chosen_by_z(tmp_path: Path, of_times: bool) -> None:
    stack = np.stack([FRAMES * 2, FRAMES], axis=1)
    if of_times:
        axes = {"metadata": {"axes": "RTYX"}}
        write(tmp_path / "a.tif", stack.swapaxes(0, 1), **axes)
    else:
        write(tmp_path / "a.tif", stack)
    with pytest.raises(InputError, match="choose one plane with --z"):
        open_frames(str(tmp_path / "a.tif")).__enter__()
    with open_frames(str(tmp_path / "a.tif"), z=1) as frames:
        assert frames.count == 4
        assert np.array_equal(frames[3], FRAMES[3])
    write(tmp_path / "b.tif", np.stack([stack, stack]))
    with pytest.raises(InputError, match="save one as an image of its own"):
        open_frames(str(tmp_path / "b.tif"), z=1).__enter__()


def test_frames_appended_one_by_one_are_a_film(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for frame in FRAMES:
            writer.write(frame, contiguous=False)
        writer.write(FRAMES[0, :5, :5])
    with open_frames(str(tmp_path / "a.tif")) as frames:
        assert frames.count == 4
        assert np.array_equal(frames[3], FRAMES[3])


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_frames_appended_some_at_a_time_are_a_film(tmp_path: Path, compression: str | None) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for some in (FRAMES[:2], FRAMES[2:3], FRAMES[3:], FRAMES[:3]):
            writer.write(some, photometric="minisblack", compression=compression)
    with open_frames(str(tmp_path / "a.tif")) as frames:
        read = [frames[i] for i in range(frames.count)]
    assert np.array_equal(read, np.concatenate([FRAMES, FRAMES[:3]]))
    with pytest.raises(InputError, match="has no axis for --z"):
        open_frames(str(tmp_path / "a.tif"), z=1).__enter__()


def test_pages_that_are_compressed_in_several_ways_keep_their_order(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        for page, how in zip(FRAMES, ("zlib", None) * len(FRAMES), strict=False):
            file.write(page, compression=how, photometric="minisblack", metadata=None)
    with open_frames(str(tmp_path / "a.tif")) as images:
        assert images.count == len(FRAMES)
        for i, page in enumerate(FRAMES):
            np.testing.assert_array_equal(images[i], page)


@pytest.mark.parametrize("count", [1, 2])
def test_stacks_of_several_types_are_refused(tmp_path: Path, count: int) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for some in (FRAMES, np.zeros((count, *FRAMES.shape[1:]), bool)):
            writer.write(some, photometric="minisblack")
    with pytest.raises(InputError, match=f"stacks are {FRAMES.dtype}, bool; save"):
        open_frames(str(tmp_path / "a.tif")).__enter__()


@pytest.mark.parametrize("shaped", [True, False])
@pytest.mark.parametrize("other", [(5, 5), (6, 9)])
def test_pages_of_different_sizes_are_refused(
    tmp_path: Path, shaped: bool, other: tuple[int, int]
) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif", shaped=shaped) as writer:
        for size in ((8, 9), other, (8, 9)):
            writer.write(np.zeros(size, np.uint8))
    with pytest.raises(InputError, match=f"pages are 8 x 9, {other[0]} x {other[1]}; save"):
        open_frames(str(tmp_path / "a.tif")).__enter__()


def test_a_tiff_knows_its_pixel_size(tmp_path: Path) -> None:
    write(
        tmp_path / "imagej.tif",
        FRAMES,
        imagej=True,
        metadata={"axes": "TYX", "unit": "um"},
        resolution=(4.0, 2.0),
    )
    sizes = {"PhysicalSizeX": 0.25, "PhysicalSizeY": 0.5}
    write(tmp_path / "a.ome.tif", FRAMES, metadata={"axes": "TYX", **sizes})
    mixed = {"PhysicalSizeX": 250, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 0.5}
    write(tmp_path / "mixed.ome.tif", FRAMES, metadata={"axes": "TYX", **mixed})
    odd = {**mixed, "PhysicalSizeXUnit": "pixel"}
    write(tmp_path / "odd.ome.tif", FRAMES, metadata={"axes": "TYX", **odd})
    write(tmp_path / "none.tif", FRAMES, imagej=True, metadata={"axes": "TYX"})
    for name, expected in (
        ("imagej.tif", ((0.5, 0.25), "µm")),
        ("a.ome.tif", ((0.5, 0.25), "µm")),
        ("mixed.ome.tif", ((0.5, 0.25), "µm")),
        ("odd.ome.tif", (None, None)),
        ("none.tif", (None, None)),
    ):
        with open_frames(str(tmp_path / name)) as frames:
            assert (frames.scale, frames.units) == expected, name


OME = {
    "a comment with other pixels": ("<Image ", '<!-- <Pixels PhysicalSizeX="9"/> --><Image ', True),
    "apostrophes": ('PhysicalSizeX="0.25"', "PhysicalSizeX='0.25'", True),
    "not XML at all": ("</Image>", "<Image & ", False),
}


@pytest.mark.parametrize(("old", "new", "known"), OME.values(), ids=OME.keys())
@pytest.mark.filterwarnings("ignore")
def test_the_description_of_ome_is_parsed(tmp_path: Path, old: str, new: str, known: bool) -> None:
    sizes = {"PhysicalSizeX": 0.25, "PhysicalSizeY": 0.5}
    write(tmp_path / "a.ome.tif", FRAMES, metadata={"axes": "TYX", **sizes})
    with tifffile.TiffFile(tmp_path / "a.ome.tif") as file:
        told = str(file.ome_metadata)
    assert old in told
    tifffile.tiffcomment(tmp_path / "a.ome.tif", told.replace(old, new, 1).encode())
    with open_frames(str(tmp_path / "a.ome.tif")) as frames:
        assert np.array_equal(frames[0], FRAMES[0])
        assert (frames.scale, frames.units) == (((0.5, 0.25), "µm") if known else (None, None))


def test_colour_becomes_luminance(tmp_path: Path) -> None:
    colour = np.random.default_rng(0).integers(0, 255, (20, 30, 3), dtype=np.uint8)
    write(tmp_path / "a.tif", colour)
    imageio.v3.imwrite(tmp_path / "a.png", colour)
    imageio.v3.imwrite(tmp_path / "alpha.png", np.dstack([colour, colour[..., :1]]))
    for name in ("a.tif", "a.png", "alpha.png"):
        with open_frames(str(tmp_path / name)) as frames:
            assert np.allclose(frames[0], colour @ LUMINANCE), name
    Image.fromarray(np.full((20, 30, 3), (90, 10, 50), np.uint8)).convert("CMYK").save(
        tmp_path / "inks.jpg", quality=100
    )
    with open_frames(str(tmp_path / "inks.jpg")) as frames:
        assert np.allclose(frames[0], (90, 10, 50) @ LUMINANCE, atol=2)


def test_colours_of_16_bits_keep_them(tmp_path: Path) -> None:
    colour = np.random.default_rng(0).integers(0, 4095, (20, 30, 3), dtype=np.uint16)
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(colour))
    with open_frames(str(tmp_path / "a.png")) as frames:
        assert np.allclose(frames[0], colour @ LUMINANCE)
    with open_frames(str(tmp_path / "a.png"), channel=2) as frames:
        assert np.array_equal(frames[0], colour[..., 2])


def test_a_channel_of_colours_is_that_channel(tmp_path: Path) -> None:
    colour = np.random.default_rng(0).integers(0, 255, (20, 30, 3), dtype=np.uint8)
    write(tmp_path / "a.tif", colour)
    write(tmp_path / "film.tif", np.stack([colour, colour]))
    imageio.v3.imwrite(tmp_path / "a.png", colour)
    for name in ("a.tif", "film.tif", "a.png"):
        with open_frames(str(tmp_path / name), channel=1) as frames:
            assert np.array_equal(frames[0], colour[..., 1]), name
        with pytest.raises(InputError, match=r"3 along axis .; there is no 3"):
            open_frames(str(tmp_path / name), channel=3).__enter__()
        with pytest.raises(InputError, match="no axis for --z; leave it out"):
            open_frames(str(tmp_path / name), z=0).__enter__()


def test_channels_that_lie_together_and_inks_are_no_colours(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (20, 30, 4), dtype=np.uint8)
    for count, photometric in ((2, "minisblack"), (4, "minisblack"), (4, "separated")):
        kind = {"photometric": photometric, "planarconfig": "contig"}
        write(tmp_path / "a.tif", pixels[..., :count], **kind)
        with pytest.raises(InputError, match=f"has {count} channels; choose one with --channel"):
            open_frames(str(tmp_path / "a.tif")).__enter__()
        with open_frames(str(tmp_path / "a.tif"), channel=1) as frames:
            assert np.array_equal(frames[0], pixels[..., 1])
    kind |= {"photometric": "minisblack", "extrasamples": ["unassalpha"]}
    write(tmp_path / "b.tif", pixels[..., :2], **kind)
    with open_frames(str(tmp_path / "b.tif")) as frames:
        assert np.array_equal(frames[0], pixels[..., 0])


def test_a_folder_and_a_glob_are_films_in_natural_order(tmp_path: Path) -> None:
    for number, frame in zip((1, 2, 10, 11), FRAMES, strict=True):
        imageio.v3.imwrite(tmp_path / f"f{number}.png", frame)
    (tmp_path / "notes.txt").write_text("no image")
    for pattern in (str(tmp_path), f"{tmp_path}{os.sep}f*.png"):
        with open_frames(pattern) as frames:
            assert frames.count == 4
            assert all(np.array_equal(frames[i], FRAMES[i]) for i in range(4))


def test_the_folder_that_one_is_in_has_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imageio.v3.imwrite(tmp_path / "f.png", FRAMES[0])
    monkeypatch.chdir(tmp_path)
    with open_frames(".") as frames:
        assert frames.name == tmp_path.name


def test_a_film_that_was_cut_off_has_its_first_frames(tmp_path: Path) -> None:
    path = tmp_path / "film.tif"
    tifffile.imwrite(path, FRAMES, photometric="minisblack")
    path.write_bytes(path.read_bytes()[: -FRAMES[0].nbytes * 3 // 2])
    with open_frames(str(path)) as frames:
        assert np.array_equal(frames[1], FRAMES[1])
        with pytest.raises(InputError, match="frame 3: cannot be read"):
            frames[3]
        with pytest.raises(InputError, match=r"frame 2: .*the file ends before it; copy"):
            frames[2]


def test_a_glob_over_folders_goes_folder_by_folder(tmp_path: Path) -> None:
    for number, frame in enumerate(FRAMES):
        folder = tmp_path / f"day-{10 - number // 2}"
        folder.mkdir(exist_ok=True)
        imageio.v3.imwrite(folder / f"f{number % 2}.png", frame)
    with open_frames(f"{tmp_path}{os.sep}day-*{os.sep}*.png") as frames:
        assert all(np.array_equal(frames[i], FRAMES[(i + 2) % 4]) for i in range(4))


def test_a_glob_in_a_folder_with_brackets_in_its_name(tmp_path: Path) -> None:
    folder = tmp_path / "plate [A1]"
    folder.mkdir()
    imageio.v3.imwrite(folder / "f0.png", FRAMES[0])
    pattern = f"{folder}{os.sep}f?.png"
    with open_frames(pattern) as frames:
        assert np.array_equal(frames[0], FRAMES[0])
    assert is_part_of(folder / "f1.png", pattern)
    assert not is_part_of(folder / "overlay.png", pattern)


def test_hidden_files_and_a_bad_first_one_do_not_stop_a_folder(tmp_path: Path) -> None:
    for number, frame in enumerate(FRAMES):
        imageio.v3.imwrite(tmp_path / f"f{number}.png", frame)
        (tmp_path / f"._f{number}.png").write_bytes(b"what macOS puts beside a file")
    (tmp_path / "f0.png").write_bytes(b"junk")
    with open_frames(str(tmp_path)) as frames:
        assert frames.count == len(FRAMES)
        assert np.array_equal(frames[1], FRAMES[1])
        with pytest.raises(InputError, match="cannot be read"):
            frames[0]
    for path in tmp_path.glob("f*.png"):
        path.write_bytes(b"junk")
    with pytest.raises(InputError, match="cannot be read"), open_frames(str(tmp_path)):
        pass


def test_how_opaque_a_grey_picture_is_does_not_matter(tmp_path: Path) -> None:
    grey = FRAMES[0].astype(np.uint8)
    imageio.v3.imwrite(tmp_path / "a.png", np.dstack([grey, np.full_like(grey, 9)]), mode="LA")
    with open_frames(str(tmp_path / "a.png")) as frames:
        assert np.array_equal(frames[0], grey)


def test_zarr_images_of_both_versions(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    axes = [{"name": "t"}, {"name": "c"}, *({"name": n, "unit": "micrometer"} for n in "yx")]
    level = {
        "path": "0",
        "coordinateTransformations": [{"type": "scale", "scale": [1.0, 1.0, 0.5, 0.25]}],
    }
    multiscales = [{"axes": axes, "datasets": [level]}]
    for version, attributes in (
        (2, {"multiscales": multiscales}),
        (3, {"ome": {"multiscales": multiscales}}),
    ):
        path = tmp_path / f"v{version}.zarr"
        group = zarr.open_group(path, mode="w", zarr_format=version, attributes=attributes)
        group.create_array("0", data=np.stack([FRAMES * 2, FRAMES], axis=1))
        with open_frames(str(path), channel=1) as frames:
            assert frames.count == 4
            assert np.array_equal(frames[3], FRAMES[3])
            assert (frames.scale, frames.units) == ((0.5, 0.25), "µm")
    zarr.create_array(tmp_path / "plain.zarr", data=FRAMES)
    with open_frames(str(tmp_path / "plain.zarr")) as frames:
        assert np.array_equal(frames[2], FRAMES[2])


def test_a_zarr_that_was_deleted_meanwhile_is_not_read_as_empty(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "film.zarr"
    zarr.create_array(path, data=FRAMES, chunks=(1, *FRAMES.shape[1:]), fill_value=7)
    with open_frames(str(path)) as frames:
        shutil.rmtree(path / "c" / "0")
        assert (frames[0] == 7).all(), "a chunk that was never written is legitimate"
        assert np.array_equal(frames[1], FRAMES[1])
        shutil.rmtree(path)
        with pytest.raises(InputError, match=r"frame 1: .*film\.zarr does not exist"):
            frames[1]


def test_the_scale_of_the_whole_zarr_image_counts_too(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    axes = [{"name": "t"}, *({"name": n, "unit": "micrometer"} for n in "yx")]
    level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 2, 1]}]}
    whole = [{"type": "scale", "scale": [0.1, 0.25, 0.5]}]
    image = {"axes": axes, "datasets": [level], "coordinateTransformations": whole}
    attributes = {"multiscales": [image]}
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2, attributes=attributes)
    group.create_array("0", data=FRAMES)
    with open_frames(str(tmp_path / "a.zarr")) as frames:
        assert (frames.scale, frames.units) == ((0.5, 0.5), "µm")


@pytest.mark.parametrize(
    ("axes", "data"),
    [({"axes": ["t", "y", "x"]}, FRAMES), ({}, FRAMES[:, None, None])],
    ids=["0.3", "0.1 and 0.2"],
)
def test_zarr_images_of_early_versions(
    tmp_path: Path, axes: dict[str, object], data: np.ndarray
) -> None:
    zarr = pytest.importorskip("zarr")
    attributes = {"multiscales": [{"datasets": [{"path": "0"}], **axes}]}
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2, attributes=attributes)
    group.create_array("0", data=data)
    with open_frames(str(tmp_path / "a.zarr")) as frames:
        assert (frames.count, frames.scale) == (4, None)
        assert np.array_equal(frames[3], FRAMES[3])


@pytest.mark.parametrize("name", ["a.avi", "a.mp4"])
def test_films_are_read_frame_by_frame(tmp_path: Path, name: str) -> None:
    pytest.importorskip("av")
    ramp = np.linspace(0, 200, 64)[None, :, None] * np.ones((48, 1, 3))
    data = np.stack([ramp + 10 * i for i in range(5)]).astype(np.uint8)
    codec = {"a.avi": "ffv1", "a.mp4": "libx264"}[name]
    imageio.v3.imwrite(tmp_path / name, data, plugin="pyav", codec=codec, fps=10)
    with open_frames(str(tmp_path / name)) as frames:
        assert frames.count == 5
        for i in (3, 0, 4):
            assert abs(frames[i].mean() - data[i].mean()) < 2
            assert frames[i].shape == (48, 64)


def test_a_film_of_uneven_times_is_read_in_any_order(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "a.mp4"), "w") as file:
        stream = file.add_stream("libx264", rate=10, width=64, height=48)
        stream.codec_context.time_base = Fraction(1, 1000)
        for i in range(20):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 10 * i, np.uint8))
            frame.pts, frame.time_base = 2000 + 90 * i + i**2, stream.codec_context.time_base
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    with open_frames(str(tmp_path / "a.mp4")) as frames:
        assert frames.count == 20
        assert [round(frames[i].mean() / 10) for i in (7, 3, 19, 18, 0, 5)] == [7, 3, 19, 18, 0, 5]


def test_a_grey_film_of_16_bits_keeps_them(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    data = np.random.default_rng(0).integers(0, 4096, (3, 48, 64)).astype(np.uint16)
    with av.open(str(tmp_path / "a.mkv"), "w") as file:
        stream = file.add_stream("ffv1", rate=10, width=64, height=48, pix_fmt="gray16le")
        for pixels in data:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, "gray16le")))
        file.mux(stream.encode())
    with open_frames(str(tmp_path / "a.mkv")) as frames:
        assert all(np.array_equal(frames[i], data[i]) for i in (2, 0, 1))
    with pytest.raises(InputError, match="no axis for --channel"):
        open_frames(str(tmp_path / "a.mkv"), channel=0).__enter__()


def test_a_damaged_frame_of_a_film_costs_no_later_one(tmp_path: Path) -> None:
    pytest.importorskip("av")
    path, data = tmp_path / "a.avi", np.random.default_rng(0).integers(0, 99, (20, 48, 64, 3))
    imageio.v3.imwrite(path, data.astype(np.uint8), plugin="pyav", codec="ffv1", fps=10)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 100] = b"x" * 100
    path.write_bytes(content)
    with open_frames(str(path)) as frames:
        with suppress(InputError):  # libraries of 2024 read the damaged one
            list(map(frames.__getitem__, range(20)))
        assert frames[19].shape == (48, 64)


def broken_tiff(path: Path) -> str:
    (path / "a.tif").write_bytes(b"II*\x00\xff\xff\xff\xff")
    return str(path / "a.tif")


def cut_png(path: Path) -> str:
    imageio.v3.imwrite(path / "a.png", FRAMES[0])
    (path / "a.png").write_bytes((path / "a.png").read_bytes()[:100])
    return str(path / "a.png")


def empty_png(path: Path) -> str:
    (path / "a.png").touch()
    return str(path / "a.png")


def word_file(path: Path) -> str:
    (path / "a.docx").write_bytes(b"PK")
    return str(path / "a.docx")


def not_a_film(path: Path) -> str:
    (path / "a.mp4").write_bytes(b"no film" * 100)
    return str(path / "a.mp4")


def empty_zarr(path: Path) -> str:
    (path / "a.zarr").mkdir()
    (path / "a.zarr" / "zarr.json").write_text("{}")
    return str(path / "a.zarr")


def zarr_of_colours(path: Path) -> str:
    zarr = pytest.importorskip("zarr")
    zarr.create_array(path / "a.zarr", data=np.zeros((20, 30, 3), np.uint8))
    return str(path / "a.zarr")


def two_axes(path: Path) -> str:
    write(path / "a.tif", np.stack([FRAMES] * 2), imagej=True, metadata={"axes": "TZYX"})
    return str(path / "a.tif")


def channels(path: Path) -> str:
    write(path / "a.tif", FRAMES, imagej=True, metadata={"axes": "CYX"})
    return str(path / "a.tif")


def colour_planes(path: Path) -> str:
    write(path / "a.tif", FRAMES[:3], photometric="rgb", planarconfig="separate")
    return str(path / "a.tif")


def stack_in_folder(path: Path) -> str:
    write(path / "a.tif", FRAMES)
    return str(path)


HOSTILE: dict[str, tuple[Callable[[Path], str], str]] = {
    "no name": (lambda path: "", "the image has no name; give a file"),
    "missing": (lambda path: str(path / "none.tif"), "no such image"),
    "empty folder": (str, "no folder or glob with images"),
    "another kind of file": (word_file, "not an image; expected one of .tif"),
    "an image of another kind": (word_file, "or a folder; save other images as TIFF"),
    "broken TIFF": (broken_tiff, "cannot be read"),
    "cut PNG": (cut_png, "a.png: cannot be read as PNG"),
    "empty PNG": (empty_png, "can not handle the given uri.); save it again"),
    "not a film": (not_a_film, "cannot be read as a film"),
    "empty Zarr": (empty_zarr, "cannot be read as OME-Zarr"),
    "Zarr of colours": (zarr_of_colours, "(20, 30, 3); expected rows and columns (y, x) last"),
    "planes and times": (two_axes, "choose one plane with --z"),
    "channels": (channels, "4 channels; choose one with --channel"),
    "planes of colours": (
        colour_planes,
        "a.tif has 3 colour planes; choose one with --channel, from 0; if they are frames, save",
    ),
    "a stack in a folder": (stack_in_folder, "4 frames; expected one per file"),
}


@pytest.mark.parametrize(("make", "reason"), HOSTILE.values(), ids=HOSTILE.keys())
def test_what_cannot_be_read_is_said(
    tmp_path: Path, make: Callable[[Path], str], reason: str
) -> None:
    name = make(tmp_path)
    with pytest.raises(InputError) as caught, open_frames(name) as frames:
        frames[0]
    assert reason in str(caught.value)


def test_a_picture_that_may_not_be_opened_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imageio.v3.imwrite(path := tmp_path / "worms.png", np.zeros((8, 8), np.uint8))

    def refuse(*arguments: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match="Permission denied"), open_frames(str(path)):
        pass


def test_a_channel_or_frame_that_is_not_there(tmp_path: Path) -> None:
    name = channels(tmp_path)
    with (
        pytest.raises(InputError, match="4 along axis C; there is no 4"),
        open_frames(name, channel=4),
    ):
        pass
    with open_frames(name, channel=3) as frames, pytest.raises(InputError, match="no frame 1"):
        frames[1]


@pytest.mark.parametrize("kind", ["uint16", "float32", "bool"])
def test_an_overlay_takes_few_copies_of_a_large_frame(kind: str, peak_memory: Any) -> None:
    frame = np.random.default_rng(0).normal(300, 90, (6000, 500)).astype(kind)
    assert peak_memory(lambda: grey(frame)) < 6 * frame.size + 2 * frame.nbytes
    shown = grey(frame)
    if kind != "bool":
        low, high = np.percentile(frame, [0.5, 99.5])
        np.testing.assert_array_equal(shown == 0, frame < low + (high - low) / 255)


def test_infinite_pixels_are_white_or_black_in_an_overlay() -> None:
    frame = np.random.default_rng(0).random((20, 30))
    frame[3, 4:6] = np.inf, -np.inf
    np.testing.assert_array_equal(grey(frame)[3, 4:6], [255, 0])


@pytest.mark.parametrize(
    ("name", "library", "extra"),
    [
        ("film.zarr", "napari_splinesketch.images.zarr_image", "formats"),
        ("https://example.org/film.zarr", "napari_splinesketch.images.zarr_image", "remote"),
        ("film.mp4", "av", "formats"),
    ],
)
def test_a_missing_library_is_said_with_the_extra_that_brings_it(
    name: str, library: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("film.zarr").mkdir()
    Path("film.zarr/zarr.json").touch()
    Path("film.mp4").touch()
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=rf"pip install 'napari-splinesketch\[{extra}\]'"):
        open_frames(name).__enter__()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_a_pipe_among_images_is_said_and_does_not_wait(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    write(tmp_path / "b.tif", FRAMES[0])
    with open_frames(str(tmp_path)) as frames:
        with pytest.raises(InputError, match="a pipe or device; expected a file"):
            frames[0]
        assert np.array_equal(frames[1], FRAMES[0])
