"""The configuration: its typed models, their YAML files, and the parameters that can be tuned."""
