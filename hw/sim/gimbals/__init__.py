"""Protocol models of the gimbals: what the real drivers talk to in the simulator and in tests.

Each file models the device below one driver: bytes, lag, limits and faults. Its `connect` makes the
driver and the model and joins them.
"""
