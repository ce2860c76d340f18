"""Series of simulated landings: which are flown, on how many processes, and what came of them."""
