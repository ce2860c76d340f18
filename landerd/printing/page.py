"""What is on a page, whatever it is written as. Millimetres, from the top left corner, y down."""

from dataclasses import dataclass

from landerd.printing.contours import Contour, Point


@dataclass(frozen=True)
class Line:
    """A straight black line."""

    start: Point
    end: Point
    width: float = 0.2
    dashed: bool = False


@dataclass(frozen=True)
class Text:
    """A line of text that begins at a point of its base line."""

    at: Point
    text: str
    size: float = 3.0  # of the letters, mm


@dataclass(frozen=True)
class Box:
    """A rectangle: its top left corner and its size."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Its right edge."""
        return self.x + self.width

    @property
    def bottom(self) -> float:
        """Its lower edge."""
        return self.y + self.height


@dataclass(frozen=True)
class Picture:
    """The pad, or the part of it that lies in a window of the page."""

    window: Box
    origin: Point  # where the plate's north-west corner lies, also outside the window
    scale: float = 1.0
    grey: float = 0.0  # of the print; 0 is black


@dataclass(frozen=True)
class Page:
    """One sheet of paper."""

    width: float
    height: float
    pictures: tuple[Picture, ...]
    lines: tuple[Line, ...]
    texts: tuple[Text, ...]
    trim: Box | None = None  # what is left when the cut marks were followed, if they are


@dataclass(frozen=True)
class Document:
    """A pad on paper."""

    title: str
    markers: tuple[tuple[Contour, ...], ...]  # of the pad, as `pad_contours` returns them
    pages: tuple[Page, ...]
