"""What to order: who flies, the states of a landing, controllers, limits, where to look."""
