"""The flight log: everything the core took in and ordered, in one MCAP file a flight."""
