"""The edges between the cells of a square marker."""

import numpy as np
from numpy.typing import NDArray

from landerd.vision.print_edges import Lines, PrintEdges


def square_edges(cells: NDArray[np.bool_], size: float) -> PrintEdges:
    """Return the edges of a print's cells.

    Args:
        cells: of the print (n, n): True is white, top row first, border included.
        size: outer edge of its border, m.
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
    # Within the print, where other codes have steps, or the same with white for black.
    foreign = lines.of(is_code & is_edge).turned().and_those(without, without.turned())
    return PrintEdges(lines.of(is_edge), is_code[is_edge], foreign, cell, size)
