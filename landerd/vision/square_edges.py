"""The edges between black and white cells of a square marker, for `square_fit`, `square_beside`."""

import numpy as np
from numpy.typing import NDArray

from landerd.vision.print_edges import Lines, PrintEdges


def square_edges(cells: NDArray[np.bool_], size: float) -> PrintEdges:
    """Return the edges of a printed square, for a fit of its pose to them.

    Args:
        cells: of the print, its black border included, (n, n): True is white, the top row first.
        size: side of the square, border included, m.
    """
    n = len(cells)
    cell = size / n
    padded = np.pad(cells, 1, constant_values=True)
    middle = (np.arange(n + 2) - 0.5) * cell - 0.5 * size
    north, east = np.meshgrid(-middle, middle, indexing="ij")
    centre = np.stack([north, east], axis=-1)
    places, ways, steps = [], [], []
    for here, there in (
        (np.s_[:-1, 1:-1], np.s_[1:, 1:-1]),  # to the south
        (np.s_[1:-1, :-1], np.s_[1:-1, 1:]),  # to the east
    ):
        a, b = (centre[side].reshape(-1, 2) for side in (here, there))
        is_rise, is_step = padded[there].ravel(), (padded[here] != padded[there]).ravel()
        places.append(0.5 * (a + b))
        ways.append(np.where(is_rise[:, None], b - a, a - b) / cell)
        steps.append(is_step)
    place, is_edge = np.concatenate(places), np.concatenate(steps)
    lines = Lines(place, np.concatenate(ways), np.zeros(len(place)))
    is_code = np.abs(lines.place).max(axis=1) < 0.5 * size - 0.75 * cell
    without = lines.of(is_code & ~is_edge)
    # Within the border other codes have edges where this one has none, or the same edge with black
    # and white exchanged.
    foreign = lines.of(is_code & is_edge).turned().and_those(without, without.turned())
    return PrintEdges(lines.of(is_edge), is_code[is_edge], foreign, cell, size)
