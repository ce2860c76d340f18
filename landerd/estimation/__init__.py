"""Where the pad is and how it moves, from sightings placed at their exposure time."""
