"""The named cases of the stability set: what is drawn, what is sketched, what should happen."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import perturbations
import stability_scenes as scenes
from stability_case import Case, Expects, Trial
from stability_scenes import Drawn, Line

from napari_splinesketch import synthetic

CASES: dict[str, Case] = {}


def _case(group: str, what: str, should: str, expects: Expects = "found"):
    """Enter a function of a random generator into the table, under its own name."""

    def enter(make: Callable[[np.random.Generator], Trial]) -> Callable:
        name = make.__name__.strip("_")

        def seeded(seed: int) -> Trial:
            return make(np.random.default_rng([seed, *name.encode()]))

        CASES[name] = Case(name, group, what, should, seeded, expects)
        return make

    return enter


def _rough(rng: np.random.Generator, line: Line, degrees: float = 10.0, far: float = 3.0) -> Line:
    """A hand-drawn line: eight points of the truth, turned and moved a little."""
    turned = synthetic.rotate(line, rng.uniform(-degrees, degrees))
    moved = perturbations.displace(turned, far * rng.random(), rng)
    return moved[np.linspace(0, len(line) - 1, 8).round().astype(int)]


def _sketched(rng: np.random.Generator, drawn: Drawn, **options) -> Trial:
    sketches = [_rough(rng, line) for line in drawn.truths]
    return Trial(drawn.image, sketches, drawn.truths, options)


BODIES = "Bodies that are hard to tell apart"
IMAGES = "Difficult images"
SIZES = "Sizes"
SKETCHES = "Careless sketches"
DATA = "Kinds of data"
NOTHING = "Nothing to find"


@_case("Nothing special", "one to three bodies that cross", "found")
def plain(rng):
    made = scenes.usual(rng, int(rng.integers(1, 4)))
    lines = [synthetic.rotate(t, rng.choice([-20, 20])) for t in made.truths]
    return Trial(made.image, lines, made.truths)


@_case(BODIES, "two bodies side by side that touch", "both found")
def parallel(rng):
    return _sketched(rng, scenes.parallel(rng))


@_case(BODIES, "the same, sketched by straight lines between their ends", "both found")
def parallel_chords(rng):
    made = scenes.parallel(rng)
    return Trial(made.image, [perturbations.chord(t) for t in made.truths], made.truths)


@_case(BODIES, "two sketches on one body", "both curves are marked", "marked")
def same_body(rng):
    made = scenes.usual(rng, 1)
    lines = [_rough(rng, made.truths[0]) for _ in range(2)]
    return Trial(made.image, lines, made.truths * 2)


@_case(BODIES, "a body that lies over itself", "found, through the crossing")
def coil(rng):
    made = scenes.coil(rng)
    return Trial(made.image, [_rough(rng, t, 5, 2) for t in made.truths], made.truths)


@_case(BODIES, "two bodies that cross at 12 to 25 degrees", "both found")
def crossing(rng):
    return _sketched(rng, scenes.crossing(rng))


@_case(BODIES, "a body that ends on the middle of another, at 20 to 40 degrees", "both found")
def junction(rng):
    return _sketched(rng, scenes.junction(rng))


@_case(BODIES, "two bodies that cross, one of them without a sketch", "the sketched one is found")
def neighbour(rng):
    made = scenes.usual(rng, 2)
    return Trial(made.image, [_rough(rng, made.truths[0])], made.truths[:1])


@_case(
    BODIES, "six bodies that cross, one line between the ends of each", "found or marked", "either"
)
def tangle(rng):
    made = scenes.usual(rng, 6, shape=(170, 180), crossing=True, shared=0.5)
    return Trial(made.image, [perturbations.chord(t) for t in made.truths], made.truths)


@_case(IMAGES, "a body of which 15 to 45 % lie outside the frame", "found as far as it can be seen")
def leaving(rng):
    return _sketched(rng, scenes.leaving(rng))


@_case(IMAGES, "contrast of one to two times the noise of a pixel", "found or marked", "either")
def faint(rng):
    return _sketched(rng, scenes.usual(rng, 1, snr=rng.uniform(1, 2)))


@_case(IMAGES, "a gradient of several contrasts, and dark corners", "found")
def vignetting(rng):
    return _sketched(rng, scenes.vignetted(rng))


@_case(
    IMAGES,
    "a thin body near the rim, the hair line or the debris of a real plate",
    "found or marked",
    "either",
)
def plate_edge(rng):
    made = scenes.plate_edge(rng)
    return Trial(made.image, [_rough(rng, t, 8, 2) for t in made.truths], made.truths)


@_case(IMAGES, "two bodies among 25 specks", "found")
def debris(rng):
    return _sketched(rng, scenes.usual(rng, 2, debris=25))


@_case(IMAGES, "bodies with strong texture and shading", "found")
def texture(rng):
    return _sketched(rng, scenes.usual(rng, 2, texture=0.2, shading=0.2))


@_case(SIZES, "bodies 1 to 1.5 px wide and 30 px long", "found")
def thin(rng):
    made = scenes.usual(rng, 3, length=30, half_width=rng.uniform(0.5, 0.75), crossing=False)
    return Trial(made.image, [_rough(rng, t, 10, 2) for t in made.truths], made.truths)


@_case(SIZES, "bodies 2 px wide and 6 px long", "found or marked", "either")
def tiny(rng):
    made = scenes.usual(rng, 3, length=6, half_width=1.0, bend=0.2, crossing=False, shape=(64, 64))
    return Trial(made.image, [_rough(rng, t, 10, 1) for t in made.truths], made.truths)


@_case(SIZES, "a body 400 px long", "found")
def huge(rng):
    made = scenes.usual(rng, 1, length=400, bend=1.2, shape=(330, 360))
    return Trial(made.image, [_rough(rng, t, 5, 5) for t in made.truths], made.truths)


def _longer(line: Line) -> Line:
    """Twice as long: straight on at both ends."""
    rough = synthetic.resample(line, 8)
    ends = [rough[i] + (rough[i] - rough[j]) * 7 / 2 for i, j in ((0, 1), (-1, -2))]
    return np.concatenate([ends[:1], rough, ends[1:]])


def _spoilt(what: str, should: str, expects: Expects = "found", bodies: int = 2, **look):
    """Enter a way to spoil the sketch of every body of a usual frame."""

    def enter(spoil: Callable[[np.random.Generator, Line], Line]) -> Callable:
        def make(rng: np.random.Generator) -> Trial:
            made = scenes.usual(rng, bodies, **look)
            return Trial(made.image, [spoil(rng, t) for t in made.truths], made.truths)

        make.__name__ = spoil.__name__
        return _case(SKETCHES, what, should, expects)(make)

    return enter


@_spoilt("a sketch twice too long", "found or marked", "either", bodies=1)
def too_long(rng, line):
    del rng
    return _longer(line)


@_spoilt("the middle half of the body", "found or marked", "either")
def too_short(rng, line):
    return synthetic.resample(line[25:75], 6) + rng.normal(0, 1, (6, 2))


@_spoilt("a sketch 25 px away", "found or marked", "either", bodies=1)
def far_off(rng, line):
    return perturbations.displace(line, 25, rng)


@_spoilt("drawn from the other end", "found")
def reversed_sketch(rng, line):
    return _rough(rng, line)[::-1]


@_spoilt("a straight line from end to end", "found")
def two_points(rng, line):
    del rng
    return perturbations.chord(line)


@_spoilt("10,000 points with a shaking hand", "found")
def many_points(rng, line):
    return synthetic.resample(line, 10_000) + rng.normal(0, 0.5, (10_000, 2))


@_spoilt("a zigzag that crosses itself", "found or marked", "either")
def zigzag(rng, line):
    points = synthetic.resample(line, 9)[[0, 2, 1, 4, 3, 6, 5, 8, 7]]
    return points + rng.normal(0, 2, points.shape)


@_case(SKETCHES, "given a half-width 0.3 times the right one", "found or marked", "either")
def told_thin(rng):
    made = scenes.usual(rng, 2)
    return _sketched(rng, made, half_width=0.3 * made.half_width)


@_case(SKETCHES, "given a half-width 3 times the right one", "found or marked", "either")
def told_wide(rng):
    made = scenes.usual(rng, 2)
    return _sketched(rng, made, half_width=3 * made.half_width)


KINDS = {
    "float16": lambda i: i.astype(np.float16),
    "uint8": lambda i: (255 * np.clip(i, 0, 1)).astype(np.uint8),
    "12 bits": lambda i: (4095 * np.clip(i, 0, 1)).astype(np.uint16),
    "int64": lambda i: (1e12 * i).astype(np.int64),
    "negative": lambda i: 1e-6 * i - 1,
    "bool": lambda i: i > (i.min() + i.max()) / 2,
}


@_case(DATA, "float16, uint8, 12 bits in uint16, int64, negative or two values", "found")
def data_types(rng):
    kind = str(rng.choice(list(KINDS)))
    look = {"gradient": (0.0, 0.0), "texture": 0.0} if kind == "bool" else {}
    trial = _sketched(rng, scenes.usual(rng, 2, **look))
    return replace(trial, image=KINDS[kind](trial.image))


@_case(DATA, "3 % of the pixels, a column and a square not finite", "found")
def missing_pixels(rng):
    trial = _sketched(rng, scenes.usual(rng, 2))
    image = trial.image.copy()
    image[rng.random(image.shape) < 0.03] = np.nan
    image[:, 100] = np.inf
    image[50:58, 60:68] = -np.inf
    return replace(trial, image=image)


def _line(rng: np.random.Generator) -> Line:
    return np.array([[30.0, 25.0], [70.0, 95.0]]) + rng.uniform(-15, 15, (2, 2))


@_case(NOTHING, "an image of one value", "marked", "marked")
def constant(rng):
    return Trial(np.full((110, 128), rng.uniform(0, 255)), [_line(rng)], [None])


@_case(NOTHING, "noise without bodies", "marked", "marked")
def noise(rng):
    return Trial(rng.normal(0.5, 0.05, (110, 128)), [_line(rng)], [None])


@_case(NOTHING, "a sketch where there is no body", "marked", "marked")
def empty(rng):
    made, line = scenes.empty(rng)
    return Trial(made.image, [*made.truths, line], [*made.truths, None])


def by_group() -> dict[str, list[Case]]:
    """The cases under their headings, in the order of the table."""
    groups: dict[str, list[Case]] = {}
    for case in CASES.values():
        groups.setdefault(case.group, []).append(case)
    return groups
