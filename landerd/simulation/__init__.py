"""One closed-loop flight: composed, recorded, its result; with the stand-in or with SITL."""
