"""Pads on paper: their black areas as contours, pages, PDF and SVG; layouts to propose and mend."""
