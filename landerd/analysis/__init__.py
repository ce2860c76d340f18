"""What happened in a landing: figures and pictures."""
