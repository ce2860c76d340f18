"""What to order: gate, phases, controllers, limits, aim."""
