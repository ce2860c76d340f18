"""Typed models of the configuration, YAML with line numbers, tunable parameters."""
