"""OME-Zarr behind a URL: a server on the loopback, of which only what is needed is asked."""

import json
import pickle
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import napari_splinesketch
from napari_splinesketch import InputError
from napari_splinesketch.batch.frame_task import Source
from napari_splinesketch.cli import main
from napari_splinesketch.images.frames import checksum, open_frames
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels

from .fakes import FakeEngine, film

zarr = pytest.importorskip("zarr")
pytest.importorskip("aiohttp")
fsspec = pytest.importorskip("fsspec")
zarr_image = pytest.importorskip("napari_splinesketch.images.zarr_image")
FRAMES = film(4)
LINE = np.array([[5.0, 6.0], [25.0, 46.0]])


class Server:
    """Serves a folder on the loopback, and remembers what was asked."""

    def __init__(self, folder: Path) -> None:
        self.asked: list[str] = []
        asked = self.asked

        class Handler(SimpleHTTPRequestHandler):
            def do_GET(self) -> None:
                if "?list-type=" not in self.path:
                    return super().do_GET()
                self.send_response(200)
                self.end_headers()
                self.wfile.write(b"<ListBucketResult><KeyCount>0</KeyCount></ListBucketResult>")

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002
                asked.append(self.path)

        self._handler = partial(Handler, directory=str(folder))
        self._address = ("127.0.0.1", 0)
        self.start()

    def start(self) -> None:
        self._server = ThreadingHTTPServer(self._address, self._handler)
        self._address = ("127.0.0.1", self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, args=(0.01,)).start()

    def stop(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._address[1]}"

    def chunks(self) -> list[str]:
        return [path for path in self.asked if "/c/" in path and "?list" not in path]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """A film of four frames, each a chunk, with sketches on frames 0, 1 and 3."""
    monkeypatch.chdir(tmp_path)
    axes = [{"name": "t"}, *({"name": name, "unit": "micrometer"} for name in "yx")]
    level = {
        "path": "0",
        "coordinateTransformations": [{"type": "scale", "scale": [1.0, 0.5, 0.25]}],
    }
    attributes = {"ome": {"multiscales": [{"axes": axes, "datasets": [level]}]}}
    group = zarr.open_group("film.zarr", mode="w", attributes=attributes)
    group.create_array("0", data=FRAMES, chunks=(1, *FRAMES.shape[1:]))
    sketches = [Label.from_sketch(LINE, frame=frame, identity=4) for frame in (0, 1, 3)]
    write_labels("sketches.csv", Labels(tuple(sketches)))
    monkeypatch.setattr(zarr_image, "PAUSES", ())
    here = Server(tmp_path)
    yield here
    here.stop()


def test_refine_asks_for_the_frames_that_it_needs(server: Server, engine: FakeEngine) -> None:
    here = ["refine", "film.zarr", "sketches.csv", "-o", "here.csv"]
    there = ["refine", f"{server.url}/film.zarr", "sketches.csv", "-o", "there.csv"]
    assert main(here) == main(there) == 0
    assert Path("there.csv").read_bytes() == Path("here.csv").read_bytes()
    assert read_labels("there.csv").scale == (0.5, 0.25)
    assert all(f"/film.zarr/0/c/{frame}/0/0" in server.chunks() for frame in (0, 1, 3))
    assert not any("/c/2/" in path for path in server.chunks())


def test_labels_say_which_film_by_its_name_and_checksums(
    server: Server, engine: FakeEngine
) -> None:
    assert main(["refine", f"{server.url}/film.zarr/", "sketches.csv", "-o", "a.geojson"]) == 0
    told = json.loads(Path("a.geojson").read_text())["splinesketch"]["provenance"]["image"]
    assert told["name"] == "film.zarr"
    assert told["sha256"] == {str(i): checksum(FRAMES[i]) for i in (0, 1, 3)}


def test_the_other_commands_read_it_too(
    server: Server, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"{server.url}/film.zarr"
    seen: list[np.ndarray] = []

    def suggest(image: np.ndarray, *options: object) -> list[np.ndarray]:
        seen.append(image)
        return [LINE]

    monkeypatch.setattr(napari_splinesketch, "suggest", suggest, raising=False)
    assert main(["suggest", url, "-o", "suggested.csv"]) == 0
    assert np.array_equal(seen, FRAMES)
    write_labels("first.csv", Labels((Label.from_sketch(LINE, identity=4),)))
    assert main(["track", url, "first.csv", "-o", "tracked.csv", "--last", "0"]) == 0
    assert len(read_labels("tracked.csv").labels) == 1
    assert main(["refine", url, "sketches.csv", "-o", "labels.csv"]) == 0
    assert main(["export-training", url, "labels.csv", "-o", "set", "--keep", "good"]) == 0
    assert json.loads(Path("set/manifest.json").read_text())["image"]["name"] == "film.zarr"


def test_a_worker_reads_it_itself(server: Server) -> None:
    with open_frames(f"{server.url}/film.zarr") as images:
        source = Source(f"{server.url}/film.zarr", None, None, images.count)
    assert server.chunks() == []
    assert np.array_equal(pickle.loads(pickle.dumps(source)).read(3), FRAMES[3])
    assert server.chunks() == ["/film.zarr/0/c/3/0/0"]


def test_an_object_store_is_read_like_a_server(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To who reads without signing in, an S3 bucket is a folder on a web server."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", server.url)
    monkeypatch.setitem(fsspec.config.conf, "s3", {"anon": True})  # as FSSPEC_S3_ANON=true does
    with open_frames("s3://film.zarr/0") as images:
        assert np.array_equal(images[2], FRAMES[2])
    assert set(server.chunks()) == {"/film.zarr/0/c/2/0/0"}


def test_a_server_that_goes_away_costs_no_finished_frame(
    server: Server,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ["refine", f"{server.url}/film.zarr", "sketches.csv", "-o", "labels.csv"]

    def last(*given: object, **options: object) -> object:
        server.stop()
        return engine(*given, **options)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(napari_splinesketch, "refine", last)
    assert main(command) == 130
    told = capsys.readouterr().err
    assert "film.zarr does not answer any more (" in told
    assert "finished frames are kept; add --resume to continue" in told
    server.start()
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    assert main([*command, "--resume"]) == 0
    assert [len(engine.calls), len(read_labels("labels.csv").labels)] == [3, 3]


def test_a_frame_that_the_server_cannot_give_is_asked_for_again_and_reported(
    server: Server, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zarr_image, "PAUSES", (0.0,))
    Path("film.zarr/0/c/1/0/0").write_bytes(b"damaged")
    url = f"{server.url}/film.zarr"
    assert main(["refine", url, "sketches.csv", "-o", "labels.csv"]) == 1
    assert server.chunks().count("/film.zarr/0/c/1/0/0") == 2
    labels = read_labels("labels.csv").labels
    assert [label.status for label in labels] == ["good", "failed", "good"]


NOWHERE = {
    "no server": ("http://127.0.0.1:1/film.zarr", "whether its server answers"),
    "nothing there": ("{}/none.zarr", "cannot be read as OME-Zarr"),
    "another kind of file": ("{}/sketches.csv", "cannot be read as OME-Zarr"),
    "unknown scheme": ("nonsense://host/film.zarr", "Protocol not known: nonsense"),
}


@pytest.mark.parametrize(("url", "reason"), NOWHERE.values(), ids=NOWHERE.keys())
def test_where_there_is_nothing_it_is_said(
    server: Server, capsys: pytest.CaptureFixture[str], url: str, reason: str
) -> None:
    url = url.format(server.url)
    assert main(["refine", url, "sketches.csv", "-o", "labels.csv"]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"napari-splinesketch refine: {url}: ")
    assert reason in told
    assert not Path("labels.csv.partial").exists()


@pytest.mark.parametrize(
    ("missing", "url"),
    [(("fsspec", "fsspec.core"), "http://127.0.0.1:1/a.zarr"), (("gcsfs",), "gs://bucket/a.zarr")],
)
def test_a_missing_library_is_said_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch, missing: tuple[str, ...], url: str
) -> None:
    for name in missing:
        monkeypatch.setitem(sys.modules, name, None)
    remedy = (
        r"needs a library \(.*\); for https and s3, pip install 'napari-splinesketch\[remote\]'"
    )
    with pytest.raises(InputError, match=remedy), open_frames(url):
        pass


class Hostile:
    """Serves a folder, but for the chunks: stalls or drips."""

    def __init__(self, server: Server, kind: str, where: str = "/c/") -> None:
        def do_get(handler: SimpleHTTPRequestHandler) -> None:
            if where not in handler.path:
                return SimpleHTTPRequestHandler.do_GET(handler)
            handler.send_response(200)
            handler.end_headers()
            with suppress(OSError):  # nobody listens any more
                self._send(handler, kind)

        self.over = threading.Event()
        server._handler.func.do_GET = do_get  # pyright: ignore

    def _send(self, handler: SimpleHTTPRequestHandler, kind: str) -> None:
        for _ in range(600):
            handler.wfile.write({"drip": b"a", "stall": b""}[kind])
            if self.over.wait(0.02):
                return


@pytest.mark.parametrize("kind", ["stall", "drip"])
def test_a_server_is_not_waited_for_without_end(
    server: Server,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kind: str,
) -> None:
    monkeypatch.setattr(zarr_image, "PATIENCE", 0.3)
    monkeypatch.setattr(zarr_image, "SLOWEST", 1_000_000)
    hostile = Hostile(server, kind)
    command = ["refine", f"{server.url}/film.zarr", "sketches.csv", "-o", "labels.csv"]
    assert main(command) == 130
    hostile.over.set()
    assert "sends nothing, or next to nothing" in capsys.readouterr().err
    assert engine.calls == []


def test_metadata_that_never_come_are_an_error(
    server: Server, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(zarr_image.RemoteStore, "patience", 0.3)
    hostile = Hostile(server, "stall", "zarr.json")
    assert main(["suggest", f"{server.url}/film.zarr", "-o", "lines.csv"]) == 2
    hostile.over.set()
    assert "sends nothing, or next to nothing" in capsys.readouterr().err


def test_a_stalled_server_is_asked_again_with_resume_for_what_it_owes(
    server: Server,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stalled = ["0/c/1/0/0"]
    real = zarr.storage.FsspecStore.get

    async def get(store: Any, key: str, *more: Any) -> Any:
        if key in stalled:
            stalled.remove(key)
            raise TimeoutError  # as at the deadline
        return await real(store, key, *more)

    monkeypatch.setattr(zarr.storage.FsspecStore, "get", get)
    command = ["refine", f"{server.url}/film.zarr", "sketches.csv", "-o", "labels.csv"]
    assert main(command) == 130
    told = capsys.readouterr().err
    assert "sends nothing, or next to nothing, of 0/c/1/0/0; try again later" in told
    assert "finished frames are kept; add --resume to continue" in told
    done = len(engine.calls)
    assert main([*command, "--resume"]) == 0
    labels = read_labels("labels.csv").labels
    assert [(label.frame, label.status) for label in labels] == [(i, "good") for i in (0, 1, 3)]
    assert [done, len(engine.calls)] == [1, 3], "no frame is refined twice"


GONE, BUSY = OSError("connection reset"), zarr_image.SilentServerError("sends nothing")
ANSWERS: dict[str, tuple[list[object], list[float], type[Exception] | None]] = {
    "at once": ([7], [], None),
    "the second time": ([GONE, 7], [1.0], None),
    "the third time": ([GONE, GONE, 7], [1.0, 5.0], None),
    "never, though it is there": ([GONE, GONE, GONE, "there"], [1.0, 5.0], OSError),
    "never, and it is gone": ([GONE, GONE, GONE, GONE], [1.0, 5.0], ConnectionError),
    "not before its deadline": ([BUSY], [], zarr_image.SilentServerError),
    "not before its deadline, later": ([GONE, BUSY], [1.0], zarr_image.SilentServerError),
}


@pytest.mark.parametrize(("answers", "pauses", "error"), ANSWERS.values(), ids=ANSWERS.keys())
def test_a_failing_server_is_asked_again_after_a_pause_and_a_stalled_one_is_not(
    monkeypatch: pytest.MonkeyPatch,
    answers: list[object],
    pauses: list[float],
    error: type[Exception] | None,
) -> None:
    coming, waited = iter(answers), []
    monkeypatch.setattr(zarr_image.time, "sleep", waited.append)

    def ask(*index: int) -> Any:
        answer = next(coming)
        if isinstance(answer, Exception):
            raise answer
        return answer

    read = zarr_image._patient(ask, "http://host/film.zarr", ask)
    if error is None:
        assert read(0) == 7
    else:
        with pytest.raises(error) as caught:
            read(0)
        assert caught.type is error
    assert waited == pauses
    assert not list(coming)


@pytest.mark.parametrize("codec", [zarr.codecs.ZstdCodec(), zarr.codecs.GzipCodec()], ids=str)
def test_shards_of_several_chunks_are_read(server: Server, codec: Any) -> None:
    data = np.arange(2 * 40 * 60, dtype=np.uint16).reshape(2, 40, 60)
    layout = {"chunks": (1, 20, 20), "shards": (1, 40, 60)}
    zarr.create_array("shards.zarr", data=data, compressors=codec, **layout)
    with open_frames(f"{server.url}/shards.zarr") as images:
        assert np.array_equal(images[1], data[1])
