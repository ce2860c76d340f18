"""Analysis of landings, simulated or from flight logs: statistics, reports, drawings, videos."""
