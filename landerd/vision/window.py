"""A rectangle of image pixels."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Window:
    """Columns x0 to x1 and rows y0 to y1 of an image, the ends not included."""

    x0: int
    y0: int
    x1: int
    y1: int

    def within(self, width: int, height: int) -> "Window":
        """Return the part of the window that lies in an image; may be empty."""
        x0, y0 = min(max(self.x0, 0), width), min(max(self.y0, 0), height)
        return Window(x0, y0, min(max(self.x1, x0), width), min(max(self.y1, y0), height))
