"""Who judges a flight: the safety rules and the score, from truth and the wire alone."""
