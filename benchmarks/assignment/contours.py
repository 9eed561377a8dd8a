"""The paper's contour plots of the cost functions, drawn from srprov's own: cost over load and pre-defined cost.

python -m benchmarks.assignment.contours
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from srprov.assignment.cost import CostTerms, Load, terms
from srprov.definitions.model import Weights

RESULTS = Path(__file__).parent / "results"
STEPS = 51
EVEN = Weights(cpu=0.25, memory=0.25, swap=0.25, bandwidth=0.25)
PANELS: dict[str, tuple[str, str, Callable[[CostTerms], float]]] = {
    "CPU load": ("alpha * beta^4", "load / CPUs", lambda cost: cost.cpu),
    "memory load (the paper's VRAM)": ("alpha * beta^4", "memory in use", lambda cost: cost.memory),
    "swap load": ("alpha * beta", "swap in use", lambda cost: cost.swap),
    "bandwidth": ("alpha * (1 - beta)^4", "bandwidth that is free", lambda cost: cost.bandwidth),
}
"""Title -> formula, what beta is, and the term of a cost; the paper's order."""


def surface(term: Callable[[CostTerms], float]) -> list[list[float]]:
    """Return the unweighted cost: a row for each alpha from 0 to 100, a column for each beta from 0 to 1."""
    shares = [step / (STEPS - 1) for step in range(STEPS)]
    loads = [Load(cpu=beta, memory=beta, swap=beta, bandwidth=beta) for beta in shares]
    return [[4 * term(terms(100 * alpha, load, EVEN)) for load in loads] for alpha in shares]


def main() -> None:
    """Write `results/contours.svg`."""
    draw(RESULTS / "contours.svg")


def draw(path: Path) -> None:
    """Draw the four functions."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "srprov"
    from matplotlib.figure import Figure

    shares = [step / (STEPS - 1) for step in range(STEPS)]
    figure = Figure(figsize=(9, 7), layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    for axes, (title, (formula, name, term)) in zip(panels.flat, PANELS.items(), strict=True):
        levels = list(range(0, 101, 5))
        drawn = axes.contourf(shares, [100 * share for share in shares], surface(term), levels=levels, cmap="viridis")
        axes.set_title(f"{title}: {formula}", fontsize=10)
        axes.set(xlabel=f"beta: {name}", ylabel="alpha: pre-defined cost")
    figure.colorbar(drawn, ax=panels, label="cost")
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
