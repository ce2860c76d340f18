"""Protocol models of the gimbals, with which the real drivers talk in the simulator and in tests.

Each file models the device that one driver talks to: its bytes, lag, limits and faults. Its
`connect` makes the driver and the model and joins them.
"""
