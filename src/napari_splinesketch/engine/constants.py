"""Every number that the engine was given, in one table.

Names that end in _HW are in half-widths of the body, in _PX in pixels, in _RAD in radians; the
others are ratios, counts or costs. A value was tuned by hand on tuning frames and images, unless
brackets say that it was fitted or measured (by which command), follows from geometry, or was chosen
for speed where results hardly change. docs/how_it_works.md says what is lost without each
mechanism.
"""

import numpy as np

# === Input: what is refused, and what is tidied before anything looks at it
# smallest half-width that a caller may give (geometry: a line one pixel wide has 0.5):
THINNEST_GIVEN_PX = 0.2
# a sketch may leave the image by this many of its longer sides (guards against wrong units):
FAR_OUTSIDE = 10.0
# image that is looked at around a long sketch, beside how far its body may be from it (speed):
AROUND_PX = 250.0
# curves are within this, also those of sketches that reach farther (labels files hold no more):
FARTHEST_PX = 1e9
# pixels beyond this are no measurement but a fill value, or overflow single precision (numerics):
LARGEST_VALUE = 1e18
LARGEST_SEED = 2_000_000_000  # those of further tries still fit into 32 bits (numerics)
SHORTEST_SKETCH_PX = 2.0  # shorter sketches have no direction (geometry)
# centrelines are shown while they are fitted every this many times of how long that takes (speed):
LINES_APART = 20
# sketches with more points are freehand strokes and are averaged down to this many (speed):
FREEHAND_POINTS = 200
# sketches are rounded to this grid, so that turning them is exact (floating point):
GRID_PX = 2.0**-10

# an image of whose second differences more than this share are 0 was drawn: it has no noise
DRAWN = 0.9
# share of an image's range below which they are 0, but for rounding (floating point):
ROUNDING = 1e-6

# === Look: ridges
WIDTH_RATIO = 1.35  # ratio of one half-width of the ladder to the next
RIDGE_BLUR_HW = 0.45  # blur before a ridge is measured; more joins neighbouring bodies
RIDGE_BLUR_PX = 0.6  # least blur before a ridge is measured
# distance from a ridge's middle to its sides, beyond the body's edge (geometry) ...
RIDGE_SIDE_HW = 1.7
RIDGE_SIDE_PX = 0.5  # ... and what is added to it in pixels (geometry)
# wide ridges are measured on an image reduced until they have this half-width (speed):
RIDGE_REDUCED_PX = 3.0
RIDGE_ANGLES = 8  # directions in half a turn in which a ridge is looked for (speed)
RIDGE_SLOPE = 0.2  # share of the drop along a ridge that counts against it: rims of blobs are steep
RIDGE_CERTAIN = 5.0  # evidence is 1 for ridges this many times as high as is usual around them
USUAL_BLOCK_HW = 10.0  # side of the blocks whose median height is what is usual ...
USUAL_BLOCK_PX = 16  # ... and its least value
RIDGE_NOISE = 1.4  # noise of the difference of two smoothed pixels, in units of one's (√2)
# pixels whose ridges are measured at a time, so that they stay in the cache (speed):
RIDGE_CHUNK = 2**15
# unused pixels after each row: where rows lie a power of two of bytes apart, as those of images of
# 1024 columns do, the pixels of a column push each other out of the cache (speed):
ROW_APART = 16
# discs of this radius are kept for the next line, px; of larger ones only a part is made (speed):
WHOLE_DISC = 256
RIDGE_FLOOR = 0.03  # ridges below this share of the bodies' count as nothing where all is smooth

# === Look: background, contrast and what surrounds a sketch
BACKGROUND_BLOCK_PX = 32  # side of the blocks whose medians are the background ...
BACKGROUND_BLOCK_HW = 6.0  # ... and its least value: less than half of a block is body (geometry)
BACKGROUND_TOLERANCE = 0.3  # share of the noise by which a simple background may miss the medians
BACKGROUND_STEP = 2  # every this many rows and columns are read for the background (speed)
MISSING_BLUR_PX = 1.5  # missing pixels are filled from those nearby with a Gaussian of this width
# a body may have another half-width whose ridges reach this share of the highest ...
OTHER_RIDGE = 0.6
OTHER_COST = 0.5  # ... and whose path costs at most this share of one of the usual
CLEAR_VOTE = 0.5  # a sketch whose vote for a polarity is clearer than this keeps it
FAINTEST_CONTRAST = 0.5  # smallest contrast of a scene, in units of the pixel noise
CREST = 0.9  # height of a body's ridge as a share of its contrast (geometry: the blur lowers it)
GIVEN_WIDTH_RIDGE = 0.75  # a given half-width is used where its ridges reach this share of the best
WIDEST_SHARE = 0.15  # largest half-width that is tried, as a share of the sketch's length ...
WIDEST_PX = 3.0  # ... but at least this
LIMBS_HW = 1.8  # and none at which a sketch that bends back is as near to itself as this, ...
LIMBS_SHARE = 0.5  # ... along this share of it (geometry: a body that touches itself is 2 apart)
CHORD_BULGE = 0.3  # a body may leave its sketch by this share of the longest segment ...
STRAY_SHARE = 0.15  # ... or by this share of the sketch's length,
STRAY_HW = 12.0  # the latter limited to this many half-widths,
STRAY_PX = 15.0  # and no less than this
WIDTH_ENOUGH = 0.92  # a body has the smallest half-width whose ridge reaches this share of the best
# height of the highest of many noise ridges, times the root of their blur, px, in units of the
# pixel noise (measured):
CHANCE_HEIGHT = 0.7
# it is in relief where one light explains this share of its ridges:
RELIEF_EXPLAINED = 0.0002
RELIEF_RUNGS = 2  # half-widths that are asked, from that of the bodies' ridges up
RELIEF_APART_HW = 2.0  # both ridges are looked for this far from the middle between them
RELIEF_USUAL = 2.0  # ridges up to this height count as nothing, in units of what is usual
# the light is looked for at these angles from where ridges lean, deg, the likeliest first:
RELIEF_TURNS = (0, -10, 10, -20, 20)
RELIEF_NEARLY = 1.1  # the likeliest is taken whose paths cost at most this much more than the least
RELIEF_PIXELS = 2**14  # about so many pixels of an image are asked (speed)
PROFILE_STEP_PX = 3.0  # distance between profiles across a sketch (speed)
PROFILES_LEAST = 12  # fewest profiles of a sketch (speed)
PROFILES_MOST = 120  # most profiles of a sketch (speed)
PROFILE_POINTS = 61  # most points of a profile (speed)
WIDTH_PROFILE_HW = 2.5  # reach of the profiles from which a half-width is read (geometry)
WIDTH_MIDDLE_HW = 0.3  # part of such a profile that is surely inside the body (geometry)

# === Find: the graph of traces
BODY_EVIDENCE = 0.45  # evidence from which a pixel is body
SPECK = 4.0  # patches of fewer squares of the half-width than this are no bodies ...
SPECK_PIXELS = 6  # ... nor those of fewer pixels
GRAPH_REACH = 1.3  # the graph reaches farther from a sketch than bodies do, by this factor ...
GRAPH_REACH_HW = 4.0  # ... and by this
# the graph reaches at least this share of the sketch's longest segment (geometry: a bow):
GRAPH_BOW = 0.7
SPUR_HW = 1.6  # shorter branches that hang on a junction are pruned
PIECE_HW = 4.0  # usual length of a piece of the graph ...
# ... longer where a body of the usual length would have more pieces than this (speed):
PIECES_A_BODY = 25
HEADING_HW = 3.0  # a piece or a line heads where this much of its end points
BRIDGE_HW = 3.5  # shorter pieces between two junctions have no direction of their own
GAP_HW = 9.0  # longest gap that a path may cross
GAP_AHEAD = 0.8  # least cosine between a free end's heading and its gap
GAP_FACING = 0.5  # least cosine between a gap and the free end on its other side
GAPS_AN_END = 3  # most gaps that are bridged from one free end (speed)
# cosine of the sharpest turn at a node: skeletons kink at crossings:
SHARPEST_TURN = np.cos(np.deg2rad(110))
ROUTES_MOST = 3000  # routes that are looked at for each sketch (speed)
ROUTE_STARTS = 12  # nodes from which routes of one sketch start (speed)
ROUTE_LENGTH = 0.05  # search cost of a half-width of route on the sketch
ROUTE_UNSEEN = 0.3  # search cost of a half-width of route without evidence
ROUTES_KEPT = 20  # routes that become candidates of a sketch (speed)

# === Find: paths along the sketch
STRIP_STEP_HW = 0.6  # step of the straightened image along the sketch (speed) ...
STRIP_STEP_PX = 1.0  # ... and its least value (speed)
STRIP_ACROSS_HW = 0.35  # step of the straightened image across the sketch (speed) ...
STRIP_ACROSS_PX = 0.5  # ... and its least value (speed)
STRIP_BEYOND = 0.12  # a path may pass the ends of its sketch by this share of its length
STRIP_STEEPEST = 1.5  # steepest path: px across for each px along
STRIP_TILT = 0.6  # cost of a step at 45 degrees to the sketch; a step without evidence costs 1
STRIP_ASTRAY = 0.25  # cost of a step at the reach
STRIP_LEFT_OUT = 0.1  # cost of a step of the sketch that is left out
STRIP_EXTRA = 0.5  # cost of a step beyond the sketch's ends
STRIP_EXTRA_MOST = 0.6  # largest cost of a step beyond the ends before they are chosen
STRIP_SEEN = 0.4  # evidence above this speaks for a step, below against it
MINIMAL_FLOOR = 0.2  # what a minimal path adds to the evidence, whose inverse a step costs
NARROW_HW = 1.0  # a path along a clicked sketch is looked for within this of its line ...
NARROW_PX = 1.0  # ... plus this; where nothing is clearly better than the sketch itself, also one
# farther away, if the sketch was moved off it as a whole: shifted and turned, its vertices miss it
# by no more than this share of what is a hit (rms):
MOVED_HITS = 0.67
# a stroke that misses a path along it by no more than that counts as clicks, unless a body goes on
# beyond both its ends by this share of its length, and by more than a click is off:
STROKE_BEYOND = 0.04
PATH_SMOOTH_HW = 1.25  # candidate paths are smoothed by this: skeletons zigzag at crossings ...
PATH_SMOOTH_CUT = 4.0  # ... with a Gaussian cut at this many standard deviations (speed)
FEW_PAIRS = 2**17  # fewer distances than this are measured one by one, not by a tree (speed)
# a hollow body's path is within this of its clicked sketch, or a rim is nearer (geometry):
HOLLOW_MIDDLE_HW = 0.5
HOLLOW_RIM_HW = 1.3  # rims of a hollow body are looked for within this of its middle (geometry) ...
HOLLOW_OFFSETS = 8  # ... at this many places on either side (speed)
# a body is not hollow where another sketch runs along so much of it, within its rims (geometry):
HOLLOW_OTHERS = 0.5
# a path that may be a rim has the other one at least this far beside it (geometry) ...
HOLLOW_APART_HW = 3.0
HOLLOW_SEEN = 0.6  # ... with this evidence along all of it, on average,
HOLLOW_ENDS = 5  # but for so many of SCORE_SAMPLES at either end, where the rims meet (geometry)
# extra cost of taking a clicked sketch for the middle of a hollow body: it may be between two:
HOLLOW_COST = 0.5

# === Find: what a path costs its sketch
SCORE_SAMPLES = 48  # points at which a path is compared with its sketch (speed)
SCORE_SAMPLES_ROUGH = 16  # points at which the many routes of a graph are compared first (speed)
SCORE_CHUNK = 2**15  # distances of vertices from paths that are measured at a time (speed)
SURE_EVIDENCE = 0.8  # evidence from which a point of a path or a suggested line is surely body
FARTHEST = 3.0  # no path is on average farther from its sketch than this many tolerances
STROKE_PX = 1.0  # a line drawn in one stroke misses its body by this ...
STROKE_SHARE = 0.05  # ... and by this share of its length
VERTEX_BULGE = 0.25  # a body leaves its sketch by this much for each px from the nearest vertex
USUAL_BEND = 0.05  # curvature times half-width that costs nothing
BEND_SMOOTH_HW = 3.0  # paths are smoothed over this before bends are measured ...
BEND_SMOOTH_MOST = 8.0  # ... but over at most this many of their samples
BEYOND_HW = (1.5, 3.0)  # where a body is looked for beyond the end of a path: from, to
HIT_HW = 0.5  # a path within this of a vertex has hit it,
HIT_PX = 1.5  # plus this,
HIT_SHARE = 0.004  # plus this share of a clicked sketch's length: long bodies are seen from afar
VERTICES_MOST = 12  # most vertices of a sketch that are compared (speed)
SHAPE_COST = 2.0  # cost of a path whose shape is not that of an unclicked line ...
SHAPE_HW = 0.5  # ... measured by how far its vertices stay off after the best shift and turn, ...
SHAPE_SIZE = 2.0  # ... and the best change of size by no more than this factor
ENDS_COST = 2.5  # cost of a path that does not end where a line of two points does ...
ENDS_SAMPLES = 4  # ... or where no body is seen at so many of its last points (speed)
# numbers of vertices of a sketch that was clicked, and not drawn in one stroke (by design):
CLICKED = range(3, 61)
CLICKED_APART_PX = 4.0  # least mean distance between clicked vertices (by design)
CLICKED_WEIGHT = (6.0, 24.0)  # weight of clicked vertices is their number, within these bounds
CLICKED_END = 0.06  # a clicked end may miss its body's tip by this share of the length more
GOES_ON = 0.5  # cost of each end beyond which a body goes on: bodies are labelled whole
GOES_ON_CLICKED = 0.7  # the same for a clicked sketch
# weights of `scoring.FEATURES` (fitted: path_weights.py; the first raised by hand):
PATH_WEIGHTS = np.array([27.0, 1.7, 2.0, 11.0, 10.5, 1.5])
IMPOSSIBLE = 1000.0  # cost of a path that its sketch cannot mean
# most that a clicked sketch costs as its own path: it stays where nothing is found:
KEPT_SKETCH = 17.0
# a clicked line ends where the image is darker than STRIP_SEEN / this of its body's brightness:
SHOWN = 4.0
UNSEEN_MOST = 0.6  # a path without evidence along more than this share is no body's

# === Find: the joint choice
# cost of running along another's path for a usual length (fitted: path_weights.py):
SHARED_COST = 14.5
EXPLAINED_GAIN = 8.0  # gain of a path along no other's for a usual length (fitted: path_weights.py)
FIXED_COST = 25.0  # cost of running along a fixed curve for a usual length
CROSSING_HW = 4.5  # shorter pieces may be shared for a tenth of the cost: bodies cross there
PLAUSIBLE = 14.0  # paths that cost this much more than their sketch's best are dropped (speed)
BEAM = 128  # sets of paths that are kept while sketch after sketch is added (speed)
SAME_PATH_PX = 1.5  # paths nearer to each other than this, or than a half-width, are the same
ON_BODY_HW = 1.0  # pieces nearer than this to a curve lie on its body (geometry)
CONTRASTS = (0.2, 4.0)  # least and largest contrast of a body against the others'

# === Find: bodies without a sketch beside those that have one
# share of a body's contrast by which a valley at its side is lower than it and than what is beyond,
# plus what noise does to pixels that are averaged over a half-width:
VALLEY = 0.3
VALLEY_FROM_HW = 0.5  # least distance of a valley from the body's path
VALLEY_TO_HW = 2.5  # how far from the path bodies beside it are taken out, plus MARGIN_PX
VALLEY_NEAREST_PX = 1.0  # a path is the nearest if no other is nearer by more (geometry)
VALLEY_STEP_PX = 0.7  # distance of the points at which that is done (geometry: less than a pixel)

# === Suggest
# least strength against the usual body's at sensitivity 0, 0.5 and 1:
SUGGEST_STRENGTH = (0.7, 0.62, 0.15)
# side of the blocks whose median height is what is usual; smaller ones hold packed bodies alone:
SUGGEST_BLOCK_HW = 30.0
# ridges of images of more pixels are measured again rather than kept: half of the memory (speed)
SUGGEST_LARGE = 2**23
SUGGEST_HIGHEST = 0.99  # quantile of an image's ridges that is the height of its bodies'
# both polarities are offered where the weaker has this share of the stronger's lines:
SUGGEST_BOTH = 0.6
SUGGEST_EVEN = 0.55  # in relief, bright and dark ridges have this share of the other's height,
SUGGEST_RISES = 1.7  # and what the light raises is so much higher than what falls
SUGGEST_WIDEST = 0.06  # largest half-width that is tried, as a share of the image's shorter side
SUGGEST_BODY = (0.3, 0.7)  # hysteresis thresholds of the evidence
SUGGEST_SHORTEST_HW = 8.0  # shorter lines are not offered
SUGGEST_WIDTH = 0.95  # a line has the smallest half-width whose ridges reach this share of the best
SUGGEST_OFF = 1  # most rungs between that half-width and the one that the line was traced at
ALIKE_ALONG = 0.1  # lines are alike within this share of their length along it ...
ALIKE_BESIDE_HW = 1.0  # ... and this beside it,
ALIKE_PLACES = 8  # on average at this many places (speed)
ALIKE_ENOUGH = 3  # lines that are found more often than this gain nothing more
RIM_HIGHER = 1.2  # a line is a rim if ridges of the other polarity beside it are so much higher,
RIM_WIDER = 1.5  # and so much wider;
RIM_AWAY_HW = 0.8  # their middle is its own half-width and this much of theirs away (geometry)
COVERED = 0.7  # a line is dropped if this share of it lies on stronger ones,
COVERED_HW = 1.2  # that is within this of them (geometry) ...
COVERED_PX = 0.5  # ... plus this (geometry)
SUGGEST_USUAL = 0.2  # the usual strength is reached by lines that make up this share of all length
# distance between the points of a suggested sketch (by design: a hand can edit it):
SUGGEST_SPACING_HW = 4.0
SUGGEST_POINTS = (4, 24)  # fewest and most points of a suggested sketch (by design)
KINK_RAD = 0.9  # lines are cut where they turn more sharply,
KINK_HW = 2.5  # measured between stretches this long ...
KINK_STEP_HW = 0.5  # ... at points this far apart (speed)
CROOKED_HW = 0.75  # the last part of a skeleton before a crossing is crooked and cut off
JOIN_HW = 8.0  # longest join of two ends
JOIN_RAD = 0.8  # sharpest turn at a join
JOIN_TURN = 8.0  # cost of a turn by one radian, squared
JOIN_FAR = 0.1  # cost of a half-width of join
JOIN_UNSEEN = 1.5  # cost of a half-width of join without evidence
JOIN_MOST = 6.0  # joins that cost more are not made
JOIN_SEEN = 0.6  # evidence from which a join is surely on a body

# === Fit: the model
WIDTH_MODES = 4  # Legendre polynomials of the half-width along a body
LIGHT_MODES = 2  # Legendre polynomials of the brightness along a body, beside the constant
# unit of the background's slopes, so that all parameters are about 1 (scaling):
SLOPE_UNIT_PX = 50.0
FINER = 16  # samples of a curve for each one that the nearest is first looked for among (speed)
EDGE_SHADE = 0.25  # the edge of a body is darker than its middle by this share: bodies are round
# distance from the end below which a taper is not followed, as a share of its extent (numerics):
TAPER_LEAST = 0.003
CURVE_SAMPLES = 64  # least number of samples that pixels find their nearest point among (speed) ...
CURVE_SAMPLES_A_KNOT = 2.6  # ... and for each knot (accuracy of the Newton step from there)
# weight of the bending energy, times half-width / length³ (tuned; ×10 either way: docs/limits.md):
BEND = 10.0
UNEVEN = 0.1  # standard deviation of the knots' spacing along a curve, as a share of it
# parameters of a curve beside its knots: mean, standard deviation and bounds before anything is
# known, in units of a normalised scene; to those of the first, the logarithm of the half-width that
# was found is added: what fits better with a much smaller one is not that body:
PRIORS = {
    "log_width_0": (0.0, 0.4, -0.6, 1.5),
    # what makes a body seem much wider at an end is beside it:
    "log_width_1": (0.0, 0.12, -0.5, 0.5),
    "log_width_2": (0.0, 0.12, -0.7, 0.2),
    "log_width_3": (0.0, 0.12, -0.3, 0.3),
    **{f"brightness_{i}": (0.0, 0.1, -0.5, 0.5) for i in range(1, LIGHT_MODES + 1)},
    "contrast": (1.0, 0.3, 0.1, 5.0),
    "log_blur": (np.log(0.7), 0.4, np.log(0.25), np.log(3.0)),
    "log_power": (np.log(0.45), 0.25, np.log(0.1), np.log(1.5)),
    "log_extent": (np.log(0.25), 0.25, np.log(0.03), np.log(0.5)),
    "tip": (0.2, 0.15, 0.0, 1.0),
    "overlap": (0.7, 0.3, 0.0, 1.0),
    "offset": (0.0, 0.15, -1.0, 1.0),
    "slope_row": (0.0, 0.1, -1.0, 1.0),
    "slope_col": (0.0, 0.1, -1.0, 1.0),
}
# standard deviations of a curve's local background where the scene's is simple:
FLAT_BACKGROUND = {"offset": 0.05, "slope_row": 0.02, "slope_col": 0.02}
# the same of the ends of a curve that is known to reach from tip to tip: a body that something
# hides looks blunt there ...
WHOLE_ENDS = {"log_power": 0.1, "log_extent": 0.1, "tip": 0.03}
WHOLE_TIP = 0.1  # ... and the half-width at its tips, as a share of the body's
PIN_PX = 0.003  # standard deviation of knots that do not move (numerics)
MARGIN_HW = 0.5  # background on either side of a body in its band ...
MARGIN_PX = 3.5  # ... and its least value
# knots may miss a path by this (rms): more knots follow neighbours and texture,
KNOT_MISS_HW = 0.15
KNOT_MISS_PX = (0.2, 1.0)  # but by no less and no more than these
# a curve whose knots would miss its path by more than this (rms) cuts corners:
CORNERS_HW = 0.75
KNOTS_FEW = 4  # so few knots only for bodies that are short: with more of them they fold,
KNOTS_SHORT_HW = 12.0  # namely shorter than this
KNOTS_MANY = 24  # more knots than this only where they are far apart,
KNOTS_APART_PX = 15.0  # namely by this: closer ones follow noise
# fixed curves are drawn with at least this half-width (geometry: one pixel):
THINNEST_FIXED_PX = 0.5

# === Fit: the solver
HUBER = 4.0  # residuals beyond this many noise standard deviations count linearly (Huber 1964)
SETTLED = 1.0  # a curve has arrived where a step gains or promises less χ² than this
DAMPING_FIRST = 0.01  # damping before the first step (Marquardt 1963): it falls ...
DAMPING = 10.0  # ... by this factor after a good step, and rises by it after a bad one,
DAMPING_LEAST = 1e-3  # but is not below this: the model is not linear over longer steps
# that of knots is not below this share of χ² a pixel (Yamashita & Fukushima 2001): in long steps
# towards what the model cannot draw, rounding would decide where curves end; ...
DAMPING_MISFIT = 0.01
DAMPING_MISFIT_MOST = 0.3  # ... at most this: a curve is to arrive within its evaluations
MOVE_HW = 0.8  # longest move of a knot in one step ...
MOVE_PX = 4.0  # ... and its least value
SWEEPS = (5, 4, 4, 4, 4, 4)  # most evaluations of each curve in each sweep over all curves (speed)
GAIN = 5.0  # a curve that gained less χ² is not visited again until a neighbour has moved (speed)
TILE = 352  # pixels worked on at a time, so that their Jacobian stays in the cache (speed)
ABREAST = 128  # curves that a GPU works on at a time (speed)
CHUNK = 128  # curves or lines between two chances to cancel (responsiveness)
# numbers of curves that arrays are padded to (few compiled programs):
CURVE_SIZES = (16, 128, 1024, 8192)
# numbers of pixels that bands are padded to (few compiled programs):
PIXEL_SIZES = tuple(TILE * n for n in (8, 32, 128))
NOWHERE_PX = 1e4  # coordinate of pixels that are padding

# === Fit: second fits and pairs
STRAY_SAMPLES = 256  # points at which a fitted curve is compared with its path (speed)
FOLD_RAD = 1.6  # a curve that turns by this within its half-width has folded over itself
STRAYED_HW = 1.0  # a curve may have strayed where it is farther than this from its path ...
STRAYED_COST = 2.0  # ... and costs this much more for what is unseen of it and how it bends
HELD_NEAR_HW = 0.25  # it is then fitted again with its knots held to the path within this
# an end may grow beyond its path by this: skeletons end before bodies do (geometry) ...
GROWTH_HW = 0.5
GROWTH_PX = 0.5  # ... plus this (geometry)
HELD_END_PX = 0.05  # ends that grew too far are held within this of where they belong (numerics),
HELD_SWEEPS = 2  # for this many more sweeps (speed)
PAIR_HW = 3.0  # two curves this close to each other ...
PAIR_SHARE = 0.6  # ... along this share of one of them may be two bodies that touch
# bodies side by side are at least this share of their half-widths' sum apart (geometry):
PAIR_APART = 0.85
PAIR_PIXELS = 8.0  # unexplained pixels that weigh as much as one unit of a path's cost
PAIR_REACH_HW = 5.0  # reach on either side in which a pair's outer edges are looked for (geometry)

# === Judge
# half-widths of ends, as a share of the body's: none, and all, of the cap belongs to the curve
BLUNT = (0.3, 0.7)
# a body ends in its cap where, so many half-widths of the end beyond that ...
BEYOND_CAP = (1.5, 2.0, 2.5)
DARK = 0.3  # ... the image is darker than this share of the body
CAP_AHEAD = 0.6  # least cosine between a curve's end and the sketch's end that its cap reaches for
CAP_POINTS = 17  # points at which the length of a cap is measured (speed)
# knots crowd where two are nearer to each other than this share of their usual distance:
CROWDED = 0.5
BORDER_POINTS = 32  # points for each knot at which a curve is checked for leaving the image (speed)
TWIN_SHARE = 0.5  # two curves are on one body where this share of one ...
TWIN_HW = 0.6  # ... is closer than this to the other
GRAIN_HW = 0.35  # residuals are averaged over this: noise averages out, misfit does not
MISFIT_ACROSS_HW = 1.5  # misfit of a point is read this far on either side of the centreline ...
MISFIT_ALONG_HW = 2.0  # ... with a Gaussian of this width along it
# a curve whose knots move less than this is not drawn again (speed):
STAYS_PX = 0.1
MOVED_SAMPLES_A_KNOT = 64  # samples of a curve that pixels of a moved body are measured to (speed)
# factor of all standard errors: bodies are not exactly tubes (measured: uncertainty.py):
SD_EVERYWHERE = 1.1
SD_BESIDE = 1.6  # further factor beside another curve (measured: uncertainty.py),
BESIDE_HW = 2.3  # that is within this
SD_END = 1.2  # further factor near the ends (measured: uncertainty.py),
END_SHARE = 0.1  # that is within this share of the points
LEAST_SD = 0.02  # added to relative standard errors before their logarithm is taken (numerics)
LEAST_ASTRAY = 0.2  # added to relative distances from the sketch before theirs is (numerics)
CLEAR_MARGIN = 3.0  # a path that all others exceed by this cost has no rival
# weights of `doubt.SIGNS` (fitted: doubt_weights.py):
DOUBT_WEIGHTS = np.array([0.9, 1.7, 1.4, 1.6])
# values of these signs in curves that are right (fitted: doubt_weights.py):
DOUBT_USUAL = np.array([-2.6, 0.3, 1.5, 0.0])
# weighted sum from which a curve needs review (chosen on its table: doubt_weights.py):
DOUBT_THRESHOLD = 3.2
# a curve whose standard error is this many half-widths needs review anyway (by design):
ADRIFT = 2.0
ENDS_HITS = 2.0  # a curve that ends so many `scoring.hit` from its sketch's end needs review,
STROKE_END = 0.14  # plus this share of the length of a sketch that is not clicked, or CLICKED_END
TELLING = 0.5  # signs that add more than this to the sum are named as reasons (by design)
# a half-width that varies by this share along a body is called a profile (by design):
WIDTH_VARIES = 0.1

# === Drawing
CUT_PX = 0.05  # the line through a drawn curve may cut its bends by this (by design)
FINEST = 6  # its points are doubled this often at most
