"""Series of simulated landings: their plans, their runs on many processes, their results."""
