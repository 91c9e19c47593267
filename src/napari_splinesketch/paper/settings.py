"""How long and how hard the paper's three phases try."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

from jaxtyping import Array, Float, Int

from napari_splinesketch.paper.loss import DEFAULT_WEIGHTS, Weights

PhaseName = Literal["background", "splines", "everything"]


@dataclass(frozen=True)
class PaperSettings:
    """How long and how hard to try."""

    knots: int = 12
    """Knots of each spline, K."""
    spacing: float = 0.8
    """Largest distance between the blobs of a sketch, in half-widths."""
    background_steps: int = 100
    splines_steps: int = 600
    everything_steps: int = 100
    """`background_steps`, `splines_steps` and `everything_steps`: Adam's steps in each phase."""
    seeds: int = 2
    """How often the second phase is tried, with different noise."""
    rate: float = 1e-2
    last_rate: float = 1e-4
    """`rate` and `last_rate`: learning rate of the first two phases, and of the last."""
    noise: float = 1.0
    noise_decay: float = 1.0
    """`noise` and `noise_decay`: η and γ: at step t the noise on the gradients has the variance η /
    (1 + t)^γ, in units of the gradient's own mean square."""
    weights: Weights = DEFAULT_WEIGHTS
    """Weights and priors of the regularizers."""

    def __post_init__(self) -> None:
        """Refuse what could not run."""
        if self.knots < 3 or self.seeds < 1 or self.spacing <= 0:
            raise ValueError(
                f"{self} cannot run: it needs at least 3 knots and 1 seed, and a spacing above 0."
            )

    def plan(self, phase: PhaseName) -> "Plan":
        """Numbers of one phase."""
        steps = getattr(self, f"{phase}_steps")
        rate = self.last_rate if phase == "everything" else self.rate
        return Plan(steps, rate, self.noise, self.noise_decay, self.weights)


class Plan(NamedTuple):
    """Numbers of one phase; data, so that other ones do not cause a compilation."""

    steps: Int[Array, ""] | int
    rate: Float[Array, ""] | float
    noise: Float[Array, ""] | float
    noise_decay: Float[Array, ""] | float
    weights: Weights
